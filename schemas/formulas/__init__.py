"""Formulas in signal temporal logic over the KPI columns of a case."""
