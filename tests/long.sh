#!/usr/bin/env bash
# What takes hours: every test with all that it draws by chance, then all of them again under the sanitizers.
set -euo pipefail
cd "$(dirname "$0")/.."
export VOLALIGN_LONG=1
./test.sh
tests/sanitize.sh
