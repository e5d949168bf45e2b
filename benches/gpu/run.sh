#!/bin/sh
# Measures a graphics processor in one command: adapters, selftest, rays per second of all cores and of the device on the
# same rays, and a frame with and without it, whose pixels are compared.
#
# usage: benches/gpu/run.sh [ADAPTER] [FOLDER]
#
# ADAPTER is a number of "gelato -gpu list"; by default the first one that is hardware. FOLDER holds the programs gelato and
# gpu, already built; by default they are built in target/release. It ends after nine minutes at the latest.
set -eu
cd "$(dirname "$0")/../.."
adapter=${1:-auto}
folder=${2:-}
if [ -z "$folder" ]; then
    cargo build --release -p gelato --features gpu
    cargo build --release -p granita-benches --features gpu --bin gpu
    folder=target/release
fi
folder=$(cd "$folder" && pwd)
root=$(pwd)
place=$(mktemp -d)
trap 'rm -rf "$place"' EXIT

echo "== adapters =="
"$folder/gelato" -gpu list

echo "== rays =="
timeout 330 "$folder/gpu" --adapter "$adapter" || echo "rays: status $?"

echo "== a frame: occlusion of a mesh =="
cp "$root/benches/gpu/occlusion.pyg" "$place/"
cd "$place"
"$folder/gpu" --ply ball.ply
for which in off "$adapter"; do
    echo "-gpu $which:"
    timeout 90 "$folder/gelato" -gpu "$which" -verbosity 2 -statistics occlusion.pyg || echo "frame: status $?"
    mv occlusion.tif "occlusion.$which.tif" 2>/dev/null || true
done
if cmp -s occlusion.off.tif "occlusion.$adapter.tif"; then echo "the images are equal"; else echo "THE IMAGES DIFFER"; fi
