#!/usr/bin/env bash
# Installs TensorBoard from PyPI into build/tensorboard, where the test train/event_file finds it.
#     tests/train/tensorboard.sh
set -euo pipefail
cd "$(dirname "$0")/../.."
python3 -m venv build/tensorboard
build/tensorboard/bin/pip install --quiet tensorboard 'setuptools<81'
build/tensorboard/bin/python -c 'import tensorboard; print("tensorboard", tensorboard.__version__)'
