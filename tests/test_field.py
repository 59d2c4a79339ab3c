"""Orientation fields against analytic pictures and independent linear algebra."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from strokeplan import field as field_module
from strokeplan.field import OrientationField, orientation_field, pyramid_factor, structure_tensor, submit_field
from strokeplan.image import grey, load_photo
from strokeplan.tractography import sample, track


def stripes(angle: float, period: float, size: int = 96) -> NDArray[np.float32]:
    """Sinusoidal stripes that run along (cos angle, sin angle)."""
    y, x = np.mgrid[:size, :size]
    across = -np.sin(angle) * x + np.cos(angle) * y
    return (0.5 + 0.5 * np.sin(2 * np.pi * across / period)).astype(np.float32)


def degrees_between(field: OrientationField, angle: float, margin: int = 16) -> NDArray[np.float64]:
    """Angle between the field's axis and a direction, for samples away from the border."""
    inner = field.samples[margin:-margin, margin:-margin]
    dot = np.abs(inner[..., 0] * np.cos(angle) + inner[..., 1] * np.sin(angle))
    return np.degrees(np.arccos(np.minimum(dot, 1.0)))


@given(angle=st.floats(0, np.pi), period=st.floats(6, 24), sigma=st.sampled_from([0.5, 1.0, 2.0, 4.0]))
def test_stripes_at_any_angle_are_followed(angle: float, period: float, sigma: float) -> None:
    field = orientation_field(stripes(angle, max(period, 3 * sigma)), sigma=sigma)
    margin = int(24 / field.scale)
    assert degrees_between(field, angle, margin).max() < 1.0
    assert field.samples[margin:-margin, margin:-margin, 2].min() > 0.95


@given(angle=st.floats(0, 2 * np.pi), sigma=st.sampled_from([0.5, 5.0]))
def test_a_linear_ramp_runs_across_its_gradient(angle: float, sigma: float) -> None:
    y, x = np.mgrid[:64, :64]
    ramp = ((np.cos(angle) * x + np.sin(angle) * y) / 200 + 0.5).astype(np.float32)
    field = orientation_field(ramp, sigma=sigma)
    margin = 24 // int(field.scale)
    assert degrees_between(field, angle + np.pi / 2, margin).max() < 0.5
    assert field.samples[margin:-margin, margin:-margin, 2].min() > 0.99


@given(
    st.sampled_from([(40, 90), (7, 5), (1, 9), (30, 20, 3), (12, 12, 1)]), st.floats(0.2, 9), st.integers(0, 1),
    st.integers(0, 1),
)  # fmt: skip
def test_filters_are_scipy_s_to_the_bit(shape: tuple[int, ...], sigma: float, axis: int, order: int) -> None:
    picture = np.random.default_rng(2).random(shape, dtype=np.float32)
    expected = gaussian_filter1d(picture, sigma, axis=axis, order=order, mode="nearest", output=np.float32)
    np.testing.assert_array_equal(field_module._gaussian(picture, sigma, axis, order), expected)


def test_white_noise_has_no_orientation_of_its_own() -> None:
    noise = np.random.default_rng(1).random((256, 256)).astype(np.float32)
    samples = orientation_field(noise, sigma=0.5).samples
    axis = np.mean(np.exp(2j * np.arctan2(samples[..., 1], samples[..., 0])))
    assert abs(axis) < 0.05  # all directions alike
    assert samples[..., 2].mean() < 0.45


def test_wider_integration_lowers_the_coherence_of_noise() -> None:
    noise = np.random.default_rng(1).random((128, 128)).astype(np.float32)
    narrow, wide = (orientation_field(noise, sigma=0.5, integration_sigma=rho).samples[..., 2] for rho in (1, 4))
    assert wide.mean() < 0.3 * narrow.mean()


@pytest.mark.parametrize("value", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("sigma", [0.5, 10.0])
def test_a_constant_picture_has_no_orientation(value: float, sigma: float) -> None:
    samples = orientation_field(np.full((70, 50), value, np.float32), sigma=sigma).samples
    assert np.isfinite(samples).all()
    assert (samples[..., 2] == 0).all()
    assert np.allclose(np.hypot(samples[..., 0], samples[..., 1]), 1)


def test_a_cross_of_equal_gradients_has_coherence_zero_at_its_centre() -> None:
    y, x = np.mgrid[-32:33, -32:33]
    saddle = (0.5 + 1e-4 * (x * x + y * y)).astype(np.float32)  # gradients in all directions around the centre
    assert orientation_field(saddle, sigma=0.5).samples[32, 32, 2] < 1e-6


def test_the_closed_form_is_the_eigensystem() -> None:
    """Minor eigenvector and coherence against numpy.linalg.eigh."""
    picture = np.random.default_rng(2).random((60, 80)).astype(np.float32)
    field = orientation_field(picture, sigma=1.0)
    jxx, jxy, jyy = structure_tensor(picture, np.sqrt(2), 1.0)
    tensor = np.stack([np.stack([jxx, jxy], -1), np.stack([jxy, jyy], -1)], -1).astype(float)
    values, vectors = np.linalg.eigh(tensor)
    coherence = ((values[..., 1] - values[..., 0]) / values.sum(-1)) ** 2
    assert np.allclose(field.samples[..., 2], coherence, atol=1e-4)
    dot = np.abs((vectors[..., :, 0] * field.samples[..., :2]).sum(-1))
    assert dot[coherence > 1e-3].min() > 1 - 1e-4


def test_derivatives_are_of_gaussian() -> None:
    """On a sinusoid of frequency k a derivative of Gaussian leaves k²·exp(−σ²k²)/2; a Sobel filter does not."""
    period, sigma = 12.0, 1.5
    k = 2 * np.pi / period
    jxx, _, jyy = structure_tensor(stripes(0.0, period), sigma, 0.0)
    power = float((jxx + jyy)[24:72, 24:72].mean())  # whole periods
    assert power == pytest.approx(0.25 * k * k * np.exp(-((sigma * k) ** 2)) / 2, rel=2e-3)


def test_blur_and_derivative_are_one_gaussian() -> None:
    """Blur by σ and then the derivative at σ_d, as the paper has it, is the derivative at √(σ² + σ_d²)."""
    picture = grey(np.random.default_rng(3).integers(0, 255, (90, 90, 3)).astype(np.uint8))
    blurred = gaussian_filter(picture, 1.0).astype(np.float32)
    two_steps = structure_tensor(blurred, 1.0, 1.0)
    one_step = structure_tensor(picture, np.sqrt(2), 1.0)
    for left, right in zip(two_steps, one_step, strict=True):
        assert np.abs(left - right)[8:-8, 8:-8].max() < 0.02 * np.abs(right).max()


def test_gradient_orientation_is_the_normal_of_the_gradient() -> None:
    picture = gaussian_filter(np.random.default_rng(4).random((60, 60)), 2).astype(np.float32)
    samples = orientation_field(picture, sigma=1.0, orientation="gradient").samples
    gx = gaussian_filter(picture, np.sqrt(2), order=(0, 1), mode="nearest")
    gy = gaussian_filter(picture, np.sqrt(2), order=(1, 0), mode="nearest")
    along = (samples[..., 0] * gx + samples[..., 1] * gy) / np.hypot(gx, gy)
    assert np.abs(along).max() < 1e-3
    assert samples[..., 2].min() > 0.999


@pytest.mark.parametrize("sigma", [1.0, 5.0])
def test_a_turned_picture_has_the_turned_field(sigma: float) -> None:
    picture = gaussian_filter(np.random.default_rng(5).random((80, 120)), 2).astype(np.float32)
    samples = orientation_field(picture, sigma=sigma).samples
    turned = orientation_field(np.rot90(picture).copy(), sigma=sigma).samples
    back = np.rot90(turned, -1)
    # rot90 takes direction (x, y) to (y, −x).
    dot = np.abs(samples[..., 0] * -back[..., 1] + samples[..., 1] * back[..., 0])
    assert np.abs(samples[..., 2] - back[..., 2]).max() < 1e-3
    assert dot[samples[..., 2] > 0.01].min() > 1 - 1e-4


@pytest.mark.parametrize("sigma", [0.5, 10.0])
def test_strips_and_threads_change_nothing(monkeypatch: pytest.MonkeyPatch, sigma: float) -> None:
    picture = np.random.default_rng(6).random((500, 90)).astype(np.float32)
    strips = orientation_field(picture, sigma=sigma).samples
    with ThreadPoolExecutor(3) as pool:
        threads = submit_field(picture, sigma=sigma, executor=pool)().samples
    monkeypatch.setattr(field_module, "STRIP_ROWS", 10**6)
    whole = orientation_field(picture, sigma=sigma).samples
    assert np.array_equal(strips, whole)
    assert np.array_equal(strips, threads)


@pytest.mark.parametrize(("sigma", "factor"), [(0.5, 1), (1.99, 1), (2, 2), (5, 2), (10, 2), (16, 4), (50, 8)])
def test_the_pyramid_begins_at_sigma_2(sigma: float, factor: int) -> None:
    assert pyramid_factor(sigma) == factor


@pytest.mark.parametrize(("sigma", "median", "percentile95"), [(2, 1.4, 20), (5, 0.4, 10), (10, 0.2, 6)])
def test_the_pyramid_agrees_with_full_resolution(
    sample_photo: Path, sigma: float, median: float, percentile95: float
) -> None:
    """To the tolerance that the module states, at random points that both fields would follow."""
    picture = grey(load_photo(sample_photo).rgb)
    small, full = orientation_field(picture, sigma=sigma), orientation_field(picture, sigma=sigma, factor=1)
    assert small.samples.shape[0] < full.samples.shape[0]
    angles = []
    for x, y in np.random.default_rng(0).random((3000, 2)) * (small.width, small.height):
        ux, uy, first = sample(small.samples, small.scale, True, x, y, 1.0, 0.0)
        vx, vy, second = sample(full.samples, full.scale, True, x, y, 1.0, 0.0)
        if min(first, second) > 0.5:
            angles.append(np.degrees(np.arccos(min(abs(ux * vx + uy * vy), 1.0))))
    assert len(angles) > 2000
    assert np.median(angles) < median
    assert np.percentile(angles, 95) < percentile95


@pytest.mark.parametrize("shape", [(2, 2), (2, 300), (300, 2), (5, 3)])
def test_slivers_have_a_field(shape: tuple[int, int]) -> None:
    picture = np.random.default_rng(7).random(shape).astype(np.float32)
    for sigma in (0.5, 10):
        assert np.isfinite(orientation_field(picture, sigma=sigma).samples).all()


# Channels


def test_one_channel_is_the_grey_picture() -> None:
    picture = np.random.default_rng(8).random((60, 50)).astype(np.float32)
    for sigma in (0.5, 5.0):
        grey_samples = orientation_field(picture, sigma=sigma).samples
        assert np.array_equal(orientation_field(picture[..., None], sigma=sigma).samples, grey_samples)


@pytest.mark.parametrize("sigma", [0.5, 5.0])
def test_channels_add_their_tensors(sigma: float) -> None:
    """Di Zenzo's tensor is blind to a rotation of the channels, and sees what only one of them has."""
    rng = np.random.default_rng(9)
    picture = gaussian_filter(rng.random((120, 100, 3)), (2, 2, 0)).astype(np.float32)
    rotation = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    samples = orientation_field(picture, sigma=sigma).samples
    rotated = orientation_field((picture @ rotation).astype(np.float32), sigma=sigma).samples
    assert np.abs(samples[..., 2] - rotated[..., 2]).max() < 2e-3
    alone = np.stack([np.zeros((96, 96), np.float32), stripes(0.7, 20)], -1)
    assert np.allclose(
        orientation_field(alone, sigma=sigma).samples, orientation_field(alone[..., 1], sigma=sigma).samples
    )


def test_opposite_gradients_of_two_channels_do_not_cancel() -> None:
    ramp = stripes(0.4, 24)
    both = orientation_field(np.stack([ramp, 1 - ramp], -1), sigma=1.0)
    assert (orientation_field(ramp + (1 - ramp), sigma=1.0).samples[..., 2] == 0).all()
    assert degrees_between(both, 0.4).max() < 1.0


# Adaptive integration


def rings_around(inner: float, size: int = 160) -> NDArray[np.float32]:
    """Concentric waves around an even disc."""
    y, x = np.mgrid[:size, :size] + 0.5 - size / 2
    radius = np.hypot(x, y)
    return np.where(radius < inner, 0.5, 0.5 + 0.5 * np.sin(radius - inner)).astype(np.float32)


def striped_with_gap(angle: float, gap: float) -> NDArray[np.float32]:
    picture = stripes(angle, 8)
    y, x = np.mgrid[:96, :96] - 47.5
    picture[np.hypot(x, y) < gap] = 0.5
    return picture


@given(angle=st.floats(0, np.pi), gap=st.floats(5, 15))
def test_a_gap_in_stripes_takes_their_direction(angle: float, gap: float) -> None:
    wide = orientation_field(striped_with_gap(angle, gap), sigma=0.5, max_integration_sigma=16).samples
    y, x = np.mgrid[:96, :96] - 47.5
    inside = np.hypot(x, y) < 0.5 * gap
    dot = np.abs(wide[inside, 0] * np.cos(angle) + wide[inside, 1] * np.sin(angle))
    # The rim of the gap, whose edges run along the rim, has a small say.
    assert np.degrees(np.arccos(np.minimum(dot, 1))).max() < 12
    assert wide[inside, 2].min() > 0.3


def test_a_tract_crosses_a_flat_disc_that_stopped_it() -> None:
    picture = striped_with_gap(0.0, 12)
    plain, wide = (
        track(orientation_field(picture, sigma=0.5, max_integration_sigma=m), (20, 48), max_length=150) for m in (0, 16)
    )
    assert np.ptp(plain[:, 0]) < 45
    assert np.ptp(wide[:, 0]) > 80
    assert np.abs(wide[:, 1] - 48).max() < 2


def test_an_even_disc_within_rings_turns_with_them() -> None:
    samples = orientation_field(rings_around(24), sigma=0.5, max_integration_sigma=32).samples
    y, x = np.mgrid[:160, :160] - 79.5
    radius = np.hypot(x, y)
    radial = np.abs(samples[..., 0] * x + samples[..., 1] * y) / radius
    inside = (radius > 8) & (radius < 23)
    assert np.degrees(np.arcsin(np.minimum(radial[inside], 1))).max() < 8
    assert (samples[radius < 23, 2] > 0).mean() > 0.99


def test_what_is_coherent_keeps_its_direction() -> None:
    picture = rings_around(0)
    plain, wide = (orientation_field(picture, sigma=0.5, max_integration_sigma=m).samples for m in (0, 16))
    y, x = np.mgrid[:160, :160] - 79.5
    clear = (np.hypot(x, y) > 20) & (np.abs(x) < 70) & (np.abs(y) < 70)
    dot = np.abs((plain[..., :2] * wide[..., :2]).sum(-1))[clear]
    assert np.degrees(np.arccos(np.minimum(dot, 1))).max() < 2


def turning(field: OrientationField) -> float:
    """Mean turn of tracts in radians per pixel."""
    turned = travelled = 0.0
    for x in range(20, field.width - 10, 40):
        for y in range(20, field.height - 10, 40):
            steps = np.diff(track(field, (x, y), max_length=60, min_coherence=0), axis=0)
            heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
            turned += np.abs(np.diff(heading)).sum()
            travelled += np.hypot(*steps.T).sum()
    return turned / travelled


@pytest.mark.parametrize("sigma", [0.5, 5.0])
def test_tracts_of_noise_turn_less(sigma: float) -> None:
    noise = np.random.default_rng(10).random((200, 200)).astype(np.float32)
    plain, some, most = (turning(orientation_field(noise, sigma=sigma, max_integration_sigma=m)) for m in (0, 8, 32))
    assert some < 0.8 * plain
    assert most < 0.6 * plain


def test_no_pixel_of_a_photo_is_without_orientation(sample_photo: Path) -> None:
    picture = grey(load_photo(sample_photo).rgb)
    picture[:150, :200] = 1.0  # burnt out, far wider than the filters reach
    assert (orientation_field(picture, sigma=0.5).samples[..., 2] == 0).sum() > 20_000
    assert (orientation_field(picture, sigma=0.5, max_integration_sigma=4).samples[..., 2] > 0).all()


@pytest.mark.parametrize("sigma", [0.5, 10.0])
def test_even_an_adaptive_average_of_nothing_is_nothing(sigma: float) -> None:
    samples = orientation_field(np.full((70, 50), 0.3, np.float32), sigma=sigma, max_integration_sigma=8).samples
    assert np.isfinite(samples).all()
    assert (samples[..., 2] == 0).all()


def test_an_averaging_that_cannot_grow_is_the_plain_one() -> None:
    picture = np.random.default_rng(11).random((40, 60)).astype(np.float32)
    plain = orientation_field(picture, sigma=0.5, integration_sigma=2).samples
    same = orientation_field(picture, sigma=0.5, integration_sigma=2, max_integration_sigma=2).samples
    assert np.array_equal(plain, same)
    gradient = orientation_field(picture, sigma=0.5, orientation="gradient").samples
    wide = orientation_field(picture, sigma=0.5, orientation="gradient", max_integration_sigma=9).samples
    assert np.array_equal(gradient, wide)


@pytest.mark.parametrize("sigma", [0.5, 10.0])
def test_strips_and_threads_change_nothing_of_an_adaptive_colour_field(
    monkeypatch: pytest.MonkeyPatch, sigma: float
) -> None:
    picture = np.random.default_rng(12).random((500, 90, 3)).astype(np.float32)
    strips = orientation_field(picture, sigma=sigma, max_integration_sigma=20).samples
    with ThreadPoolExecutor(3) as pool:
        threads = submit_field(picture, sigma=sigma, max_integration_sigma=20, executor=pool)().samples
    monkeypatch.setattr(field_module, "STRIP_ROWS", 10**6)
    whole = orientation_field(picture, sigma=sigma, max_integration_sigma=20).samples
    assert np.array_equal(strips, whole)
    assert np.array_equal(strips, threads)


@pytest.mark.parametrize("shape", [(1, 1), (2, 2), (2, 300), (300, 2), (5, 3)])
def test_slivers_have_an_adaptive_field(shape: tuple[int, int]) -> None:
    picture = np.random.default_rng(13).random(shape).astype(np.float32)
    for sigma in (0.5, 10):
        samples = orientation_field(picture, sigma=sigma, max_integration_sigma=50).samples
        assert np.isfinite(samples).all()
        assert np.allclose(np.hypot(samples[..., 0], samples[..., 1]), 1)
