"""Manoeuvres that compare a vehicle with closed forms, regulations and published figures."""
