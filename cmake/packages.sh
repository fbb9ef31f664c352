# Sourced by the scripts that build (quickstart.sh, test.sh, tests/long/sanitize.sh, tests/long/tidy.sh): the Debian 12 packages that
# volalign is built from, and how a preset is built.

VOLALIGN_BUILD_PACKAGES=(
  g++ cmake ninja-build pkg-config
  libtorch-dev libgloo-dev libopenblas0-pthread
  libeigen3-dev libnanoflann-dev libceres-dev libopencv-dev
  libegl-dev libegl1 libgl1-mesa-dri libepoxy-dev
  libassimp-dev libembree-dev libtinygltf-dev libyaml-cpp-dev nlohmann-json3-dev libpng-dev libssl-dev
  libcli11-dev libfmt-dev libonnx-dev libprotobuf-dev protobuf-compiler
  libjs-three
  pybind11-dev python3-dev
  libtiff-dev libopenexr-dev libavformat-dev libbz2-dev zlib1g-dev liblz4-dev libzstd-dev libsqlite3-dev
)
VOLALIGN_TEST_PACKAGES=(libgtest-dev dpkg-dev file iproute2 python3 python3-numpy python3-pil python3-pytest python3-torch)
# For the test of report.html, which is left out without them: 120 MB to fetch, 380 MB installed. CI has them.
VOLALIGN_BROWSER_PACKAGES=(chromium chromium-driver fonts-dejavu-core python3-selenium)
# For the tests that compare with other programs' readers and writers, beside tests/requirements.txt, and for the reference of the headers; likewise.
VOLALIGN_READERS_PACKAGES=(mkvtoolnix python3-venv doxygen)
# llvm-14 has the symbolizer, which names the functions in a sanitizer's report.
VOLALIGN_SANITIZER_PACKAGES=(clang-14 libclang-rt-14-dev llvm-14)
VOLALIGN_TIDY_PACKAGES=(clang-14 clang-tidy-14)

# install_packages NAME...: installs what is missing, as root or through sudo; names what cannot be had.
install_packages() {
  local missing=() package
  for package in "$@"; do
    [ "$(dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null)" = installed ] || missing+=("$package")
  done
  if [ ${#missing[@]} -eq 0 ]; then
    echo "packages: all ${#} are installed"
    return
  fi
  echo "packages: installing ${missing[*]}"
  local as_root=()
  if [ "$(id -u)" -ne 0 ]; then
    if ! command -v sudo >/dev/null; then
      echo "error: these Debian packages are missing: ${missing[*]}; run this as root, or install them first" >&2
      return 1
    fi
    as_root=(sudo)
  fi
  local log
  log=$(mktemp)
  if ! { "${as_root[@]}" apt-get update -qq &&
         "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
           apt-get install -y -qq --no-install-recommends "${missing[@]}"; } >"$log" 2>&1; then
    tail -n 5 "$log" >&2
    echo "error: apt-get could not install ${missing[*]}; Debian 12 (bookworm) is expected; the log is $log" >&2
    return 1
  fi
  rm -f "$log"
}

# build_preset NAME [-DOPTION=VALUE ...] TARGET...: configures (a few seconds where nothing changed) and builds. Options stay
# as they were set last in the preset's build folder, so that quickstart.sh and test.sh share one.
build_preset() {
  local preset=$1 options=()
  shift
  while [[ "${1:-}" == -D* ]]; do
    options+=("$1")
    shift
  done
  local log=build-$preset.log
  if ! cmake --preset "$preset" "${options[@]}" >"$log" 2>&1; then
    tail -n 20 "$log" >&2
    echo "error: cmake --preset $preset failed; the log is $log" >&2
    return 1
  fi
  rm -f "$log"
  cmake --build --preset "$preset" --target "$@"
}
