#!/bin/sh
# library.sh MODEL LIBRARY: an Arduino library in the new folder LIBRARY, around a folder of C whose
# --name was wake.
set -eu
model=$1 library=$2
here=$(dirname "$0")
[ -e "$library" ] && { echo "$library is there already; name a new folder." >&2; exit 2; }
[ -e "$model/wake.c" ] || { echo "$model has no wake.c: export it with --name wake." >&2; exit 2; }
mkdir -p "$library/src" "$library/examples"
cp "$here/library.properties" "$library/"
cp "$model/wake.c" "$model/wake.h" "$model/README.md" "$library/src/"
cp -r "$here/examples/Wake" "$library/examples/"
