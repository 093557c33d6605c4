#!/usr/bin/env bash
# Trains one place, then one style stage per variant of the hypernetwork and its losses, and prints
# what paintings that were never seen make of it.
#
#   docs/ablations.sh CAPTURE PAINTINGS OTHER_PAINTINGS [FOLDER]
#
# Steps are counted, not time, so that a busy machine gives the same table. Environment: IMPASTO (the
# program, default `impasto`), STEPS (of each style stage, default 2000), DOWNSCALE (default 4).
set -euo pipefail

capture=$1 paintings=$2 others=$3 folder=${4:-ablations}
impasto=${IMPASTO:-impasto} steps=${STEPS:-2000} downscale=${DOWNSCALE:-4}
mkdir -p "$folder"

# A width of its own: the painter that the program holds, which has learned already, is made for another.
common=(--styles "$paintings" --downscale "$downscale" --set style.hyper_width=65)
if [ ! -e "$folder/geometry/model.safetensors" ]; then
    "$impasto" train "$capture" -o "$folder/geometry" "${common[@]}" --stage geometry --steps 3000
fi
# What `--layers relu4_1` reads is the paper's own input; the preset's codes see all four layers.
if [ ! -e "$folder/relu4_1.safetensors" ]; then
    "$impasto" train-encoder --styles "$paintings" --layers relu4_1 -o "$folder/relu4_1.safetensors"
fi

# Name, then what differs from the preset.
variants=(
    "preset"
    "seed 1 (noise)|--seed 1"
    "no LayerNorm|--set style_app.layer_norm=false"
    "predicted: last 2 of 3 layers|--set style.predicted_layers=2"
    "predicted: last layer|--set style.predicted_layers=1"
    "z from relu4_1|--encoder $folder/relu4_1.safetensors"
    "plain mu|--set style.weigh_codes=false"
    "photo term|--set style.photo_weight=1"
    "warm-up, a tenth|--set style.style_loss_start=$((steps / 10))"
    "one distance of all layers|--set style.style_reduction=concatenated --set style.style_weight=60"
    "strides 1/2, 1/3|--set style.strides={\"paper\":[2,3]}"
    "strides 1/1, 1/1|--set style.strides={\"paper\":[1,1]}"
    "patch 34x40|--set style.patch=[34,40]"
)

printf '| variant | style gain | retrieval | style loss | content loss |\n|---|---|---|---|---|\n'
for variant in "${variants[@]}"; do
    IFS='|' read -r name settings <<< "$variant"
    model="$folder/${name//[^a-zA-Z0-9]/_}"
    if [ ! -e "$model.json" ]; then
        rm -rf "$model"
        cp -r "$folder/geometry" "$model"
        read -ra arguments <<< "${settings:-}"
        "$impasto" train "$capture" -o "$model" "${common[@]}" --stage style --steps "$steps" \
            "${arguments[@]}" 2> "$model.log"
        "$impasto" eval "$model" --styles "$others" --frames 0 --json > "$model.part" 2>> "$model.log"
        mv "$model.part" "$model.json"
        rm -r "$model"
    fi
    python3 - "$name" "$model.json" <<'PYTHON'
import json, sys

m = json.load(open(sys.argv[2]))["methods"]["impasto"]
print(f"| {sys.argv[1]} | {m['style_gain']:.3f} | {100 * m['retrieval']:.0f} % "
      f"| {m['style_loss']:.3f} | {m['content_loss']:.2f} |", flush=True)
PYTHON
done
