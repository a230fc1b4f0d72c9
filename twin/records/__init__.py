"""Files of a run: KPI rows, drive records, and logs of the AutoDRIVE study."""
