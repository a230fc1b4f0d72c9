"""OpenSCENARIO XML 1.0 to 1.3: files are read, checked and expanded; they are not played yet."""
