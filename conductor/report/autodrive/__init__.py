"""The AutoDRIVE study's layout: logs in, cases out."""
