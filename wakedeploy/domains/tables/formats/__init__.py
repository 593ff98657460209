"""A module for each kind of log; each has `open_log(path, csv)` and imports its library inside."""
