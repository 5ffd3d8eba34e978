# shellcheck shell=bash
# The Debian packages that ecir needs, and a function that installs those that are missing. Sourced.
# shellcheck disable=SC2034 # The lists are used by whoever sources this.

build_packages=(
    ca-certificates git
    cmake g++ ninja-build pkg-config
    glslang-tools libspirv-cross-c-shared-dev libvulkan-dev
    libcli11-dev libeigen3-dev libhdf5-dev libopencv-dev nlohmann-json3-dev
    flatbuffers-compiler libflatbuffers-dev liblz4-dev libzstd-dev
)
# lavapipe, the CPU driver, and the open GPU drivers.
run_packages=(mesa-vulkan-drivers)
test_packages=(doctest-dev vulkan-validationlayers)

# package_missing NAME: true unless it is installed whole.
package_missing() {
    [[ "$(dpkg-query -W -f '${db:Status-Abbrev}' "$1" 2>/dev/null)" != ?i* ]]
}

# install_missing LOG PACKAGE...: installs what is missing without asking; what apt says goes to LOG.
install_missing() {
    local log=$1 package missing=() as_root=()
    shift
    if ! command -v apt-get >/dev/null; then
        echo "no apt-get here: going on with what is installed; needed are (names of Debian 12): $*"
        return
    fi
    for package in "$@"; do
        if package_missing "$package"; then
            missing+=("$package")
        fi
    done
    if [[ ${#missing[@]} -eq 0 ]]; then
        echo "all ${#} packages are there"
        return
    fi
    if [[ $EUID -ne 0 ]]; then
        if ! command -v sudo >/dev/null; then
            echo "missing packages: ${missing[*]}; run this as root, or install them yourself" >&2
            return 1
        fi
        as_root=(sudo)
    fi
    local apt=("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive
        apt-get -qq -o DPkg::Lock::Timeout=300)
    local install=("${apt[@]}" install -y --no-install-recommends "${missing[@]}")
    echo "installing ${missing[*]} (log: $log)"
    : >"$log"
    # The lists are fetched only where apt does not know a package yet, or knows one that is gone.
    if "${apt[@]}" install -s "${missing[@]}" >/dev/null 2>&1 && "${install[@]}" >>"$log" 2>&1; then
        return
    fi
    if ! { "${apt[@]}" update && "${install[@]}"; } >>"$log" 2>&1; then
        tail -n 20 "$log" >&2
        echo "the packages could not be installed; the whole log is in $log" >&2
        return 1
    fi
}
