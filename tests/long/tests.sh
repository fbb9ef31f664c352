#!/usr/bin/env bash
# Every test, with all that it draws by chance.
VOLALIGN_LONG=1 exec "$(dirname "$0")/../../test.sh"
