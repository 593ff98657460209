"""The version of this code, which files and messages state."""

VERSION = "0.1.0"
