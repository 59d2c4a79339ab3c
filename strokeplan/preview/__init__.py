"""Watching a plan being painted: a page that plays it (page.py) and a time lapse as a moving picture (timelapse.py)."""

from __future__ import annotations

from strokeplan.preview.page import check_page, encode, save_page
from strokeplan.preview.timelapse import check_time_lapse, save_time_lapse

__all__ = ["check_page", "check_time_lapse", "encode", "save_page", "save_time_lapse"]
