"""Scenarios made of storyboards: entities, triggers and actions."""
