# shellcheck shell=bash
# What tools/demo and tools/test share. Sourced.

# phase NAME COMMAND...: runs it, saying what it is and how long it took.
phase() {
    local name=$1 start=$SECONDS
    shift
    echo "== $name"
    "$@"
    echo "== $name: $((SECONDS - start)) s"
}

# build_quietly FOLDER [TARGET...]: on a terminal ninja's one line, else warnings and errors only.
build_quietly() {
    local folder=$1 quiet=(--quiet)
    shift
    if [[ -t 1 ]]; then
        quiet=()
    fi
    ninja -C "$folder" "${quiet[@]}" "$@"
}
