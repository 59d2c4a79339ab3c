"""Watching a plan being painted: a page that plays it (page.py) and a time lapse as a moving picture (timelapse.py)."""

from __future__ import annotations

from strokeplan.preview.page import encode

__all__ = ["encode"]
