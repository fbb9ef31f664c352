#!/usr/bin/env bash
# Both commands of the README on Debian 13: makes a root of it by debootstrap, copies the committed tree there, and runs quickstart.sh and
# test.sh in it. Needs root, debootstrap, and the network; half an hour and 12 GB.
#
#     tests/compat/debian13.sh [FOLDER] [ARGUMENT OF CTEST ...]      # FOLDER: by default build/debian13; an interrupted run goes on there
set -euo pipefail
cd "$(dirname "$0")/../.."
root=$(realpath -m "${1:-build/debian13}")
shift || true
mirror=${MIRROR:-http://deb.debian.org/debian}
if [ ! -e "$root/etc/debian_version" ]; then
  mkdir -p "$root"
  debootstrap --variant=minbase trixie "$root" "$mirror"
fi
mounted=()
bind() {
  mountpoint -q "$root/$1" || { mount --rbind "/$1" "$root/$1" && mount --make-rslave "$root/$1"; }
  mounted+=("$root/$1")
}
leave() { for folder in "${mounted[@]}"; do umount -R "$folder" || true; done; }
trap leave EXIT
bind proc
bind dev
bind sys
cp /etc/resolv.conf "$root/etc/resolv.conf"
# Not below a folder "volalign": tests look for the name of the source tree in what is installed.
mkdir -p "$root/srv/clone"
git archive HEAD | tar -x -C "$root/srv/clone"
run() { chroot "$root" /usr/bin/env -i HOME=/root TERM=dumb PATH=/usr/sbin:/usr/bin:/sbin:/bin "$@"; }
run bash -c "cat /etc/debian_version; cd /srv/clone && ./quickstart.sh && ./test.sh $*"
