#!/usr/bin/env bash
# Prints the labels needs-* of the tests that this machine cannot run, as an expression for `ctest -LE`, and says on stderr why.
# A test that is run is never skipped: what it needs is its label, or installed by test.sh.
#   tests/missing.sh [PYTHON]     the Python that CMake was told, /usr/bin/python3
missing=() python=${1:-/usr/bin/python3}
without() { missing+=("needs-$1"); echo "left out: tests of the label needs-$1, without $2" >&2; }
modules='onnxruntime open3d pycolmap pyrealsense2 imageio_ffmpeg tensorboard trimesh pygltflib pybind11_stubgen safetensors mkdocs'
"$python" -c "from importlib.util import find_spec; import sys; sys.exit(not all(map(find_spec, '$modules'.split())))" ||
  without pypi "the packages of tests/requirements.txt"
[ -d "${VOLALIGN_CAPTURES:-/none}" ] || without frames "VOLALIGN_CAPTURES, a folder of real frames"
command -v chromedriver >/dev/null && "$python" -c 'import selenium' 2>/dev/null || without chromium "the programs chromium and chromedriver, and Selenium"
for tool in doxygen mkvmerge; do command -v "$tool" >/dev/null || without "$tool" "the program $tool"; done
for flag in avx2 avx512_bf16; do grep -qw "$flag" /proc/cpuinfo || without "$flag" "the processor's $flag"; done
[ -e /usr/include/gloo/config.h ] || without gloo "the package libgloo-dev"
"$python" -c 'import sys, torch; sys.exit(not torch.cuda.is_available())' 2>/dev/null || without gpu "a GPU that LibTorch uses"
unshare --map-root-user --mount mount --bind /dev/null /etc/passwd 2>/dev/null || without namespaces "mount namespaces for ordinary users"
ip netns add "volalign-$$" 2>/dev/null && ip netns delete "volalign-$$" && ip link add "v$$" type veth 2>/dev/null && ip link delete "v$$" ||
  without network-namespaces "root, iproute2 and network namespaces"
(IFS='|'; echo "^(${missing[*]})$")
