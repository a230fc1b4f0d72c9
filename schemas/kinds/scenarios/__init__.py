"""Declarations of the scenario families that are shipped."""

from schemas.kinds.scenarios import jump_scare, lane_keeping, storyboard

KINDS = (jump_scare.KIND, lane_keeping.KIND, storyboard.KIND)
