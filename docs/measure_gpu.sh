#!/usr/bin/env bash
# Times impasto on a bare x86-64 Linux machine that has a GPU and its driver, but neither network nor
# compilers.
#
#   docs/measure_gpu.sh pack BUNDLE [SCENE...] [--styles FOLDER]
#       here: builds, and puts into the folder BUNDLE all that the other machine needs, at most
#       64 MiB: a stripped binary, the Vulkan loader, captures, at most 16 paintings and this script.
#       Without captures it is the built-in one that is measured.
#   BUNDLE/measure_gpu.sh run [OUT]
#       there: prints a short table; every command's answer is kept in OUT (measured/ by default).
#
# IMPASTO_DEVICE chooses the device (gpu by default). BUDGETS (seconds of geometry stage), STEPS (of
# the style stage), SIZE (of rendered views) and DOWNSCALE (of photos) may be set for a first try; PAPER=no leaves out the paper
# preset, whose check of held-out views takes a CPU many minutes.
set -euo pipefail
# Numbers have points, and the tools of administrators are found.
export LC_ALL=C PATH="$PATH:/usr/sbin:/sbin"

LIMIT_MIB=64

pack() {
    local bundle=$1 root styles="" scenes=()
    shift
    while [ $# -gt 0 ]; do
        case $1 in
            --styles) styles=$2; shift 2 ;;
            *) scenes+=("$1"); shift ;;
        esac
    done
    root=$(cd "$(dirname "$0")/.." && pwd)
    (cd "$root" && cargo build --locked --release --workspace --features gpu)
    rm -rf "$bundle/scenes" "$bundle/styles" "$bundle/lib"
    mkdir -p "$bundle/scenes" "$bundle/styles" "$bundle/lib"
    strip -o "$bundle/impasto" "${CARGO_TARGET_DIR:-$root/target}/release/impasto"
    xz -f -6 "$bundle/impasto"
    # Drivers bring their own parts; the loader that finds them may be missing.
    local loader
    loader=$(ldconfig -p | sed -n 's/.*libvulkan\.so\.1 .*=> //p' | sed -n 1p)
    if [ -n "$loader" ]; then
        cp -L "$loader" "$bundle/lib/libvulkan.so.1"
    else
        echo "note: no Vulkan loader here; the other machine must have one" >&2
    fi
    for scene in "${scenes[@]}"; do
        cp -rL "$scene" "$bundle/scenes/"
    done
    if [ -n "$styles" ]; then
        find "$styles" -type f | sort | sed -n '1,16p' | while read -r painting; do
            cp -L "$painting" "$bundle/styles/"
        done
    fi
    cp "$0" "$bundle/measure_gpu.sh"
    local size
    size=$(du -sm "$bundle" | cut -f1)
    echo "$bundle: $size MiB"
    if [ "$size" -gt "$LIMIT_MIB" ]; then
        echo "that is more than $LIMIT_MIB MiB: leave out a capture" >&2
        return 1
    fi
}

# The number of a key in a line of JSON, the last there is.
number() {
    sed -n "s/.*\"$1\":\(-\{0,1\}[0-9.e+-]*\).*/\1/p" "$2" | tail -n 1
}

# A stage's last step in a model's log, as a line of JSON.
last_step() {
    grep '"event":"step"' "$1/log.jsonl" | grep "\"stage\":\"$2\"" | tail -n 1
}

row() {
    printf '%-66s %s\n' "$1" "$2"
}

# A number and its unit.
in_units() {
    printf '%.2f %s' "$1" "$2"
}

run() {
    local here out=${1:-measured} model
    here=$(cd "$(dirname "$0")" && pwd)
    mkdir -p "$out"
    out=$(cd "$out" && pwd)
    export LD_LIBRARY_PATH="$here/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}"
    export IMPASTO_DEVICE=${IMPASTO_DEVICE:-gpu} IMPASTO_CACHE="$out/cache"
    xz -dc "$here/impasto.xz" > "$out/impasto" ||
        python3 -c 'import lzma, sys; sys.stdout.buffer.write(lzma.open(sys.argv[1]).read())' \
            "$here/impasto.xz" > "$out/impasto"
    chmod +x "$out/impasto"
    local impasto="$out/impasto" budgets=${BUDGETS:-20 60} steps=${STEPS:-1000} size=${SIZE:-1920x1080}
    local painted=()
    if [ -n "$(ls "$here/styles")" ]; then
        painted=(--styles "$here/styles" --set style.generated=16)
    fi

    "$impasto" bench > "$out/bench.txt"
    cat "$out/bench.txt"
    echo
    local scenes=("$here"/scenes/*/)
    if [ ! -d "${scenes[0]}" ]; then
        "$impasto" demo --out "$out/demo" --budget 10s > /dev/null
        scenes=("$out/demo/scene")
    fi
    for scene in "${scenes[@]}"; do
        local name
        name=$(basename "$scene")
        for seconds in $budgets; do
            model="$out/$name-${seconds}s"
            "$impasto" train "$scene" -o "$model" --stage geometry --budget "${seconds}s" \
                --downscale "${DOWNSCALE:-1}" --json \
                > "$model.json"
            last_step "$model" geometry > "$model.step"
            row "$name, geometry stage, ${seconds} s in all: held-out PSNR" \
                "$(in_units "$(number psnr "$model.json")" dB), \
$(in_units "$(number rays_per_second "$model.step")" rays/s)"
        done
    done
    for patch in 67,81 134,162; do
        "$impasto" train "$scene" -o "$model" --stage style "${painted[@]}" --steps "$steps" \
            --downscale "${DOWNSCALE:-1}" \
            --set "style.patch=[$patch]" --set style.supersampling=1 --json > "$out/style.json"
        last_step "$model" style > "$out/style-$patch.step"
        row "style stage, patches of $patch" \
            "$(in_units "$(number rate "$out/style-$patch.step")" updates/s)"
    done
    row "rendering, default look" "$("$impasto" bench --model "$model" --size "$size")"
    [ "${PAPER:-yes}" = yes ] || return 0
    model="$out/paper"
    "$impasto" train "$scene" -o "$model" --preset paper "${painted[@]}" --steps "$((steps / 25 + 4))" \
        --downscale "${DOWNSCALE:-1}" --json > "$model.json"
    for stage in geometry style; do
        last_step "$model" "$stage" > "$model.step"
        row "paper preset, $stage stage, compiling included" "$(in_units "$(number rate "$model.step")" steps/s)"
    done
}

case ${1:-} in
    pack) shift; pack "$@" ;;
    run) shift; run "$@" ;;
    *) sed -n '2,14p' "$0"; exit 2 ;;
esac
