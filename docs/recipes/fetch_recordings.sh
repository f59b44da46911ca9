#!/usr/bin/env bash
# Fetches the recordings of a list, and keeps those that are there already:   fetch_recordings.sh LIST FOLDER
#
# A line of the list is a SHA-256 and an address that curl reads: the name of the file is its last part. A file whose sum is
# another one is fetched again; when that does not help, nothing is left of it and the status is 1.
set -euo pipefail

list=$1 folder=$2
mkdir -p "$folder"
while read -r sum address || [ -n "$sum" ]; do # the last line may end with the file
    if [ -z "$sum" ] || [ "${sum:0:1}" = "#" ]; then
        continue
    fi
    file="$folder/${address##*/}"
    if echo "$sum  $file" | sha256sum --check --status 2>/dev/null; then
        continue
    fi
    curl --fail --silent --show-error --location --retry 3 --output "$file.part" "$address"
    if ! echo "$sum  $file.part" | sha256sum --check --status; then
        rm -f "$file.part"
        echo "$address is not the recording of $list: its sum is another one" >&2
        exit 1
    fi
    mv "$file.part" "$file"
    echo "fetched $file"
done <"$list"
