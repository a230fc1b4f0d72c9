#!/usr/bin/env bash
# Puts Apptainer into FOLDER (about 100 MB, ten seconds) and prints the path of its command. Nothing
# outside FOLDER is touched. Debian 12 has no package of it: sid's is unpacked together with the C
# library that it was built for, and its programs are told to use that one.
#
# usage: install_apptainer.sh FOLDER      needs: patchelf squashfs-tools squashfuse uidmap fakeroot
set -euo pipefail
folder=$(mkdir -p "$1" && cd "$1" && pwd)
[ ! -x "$folder/root/usr/bin/apptainer" ] || { echo "$folder/root/usr/bin/apptainer"; exit 0; }
cd "$folder"
mkdir -p apt/lists/partial apt/cache/archives/partial debs root
key=/usr/share/keyrings/debian-archive-keyring.gpg
echo "deb [signed-by=$key] http://deb.debian.org/debian sid main" >apt/sources.list
options=(
  -q -o Dir::Etc::SourceList="$PWD/apt/sources.list" -o Dir::Etc::SourceParts=/dev/null
  -o Dir::State::Lists="$PWD/apt/lists" -o Dir::Cache="$PWD/apt/cache"
  -o Dir::State::status=/dev/null -o Acquire::Languages=none -o APT::Sandbox::User=root
)
apt-get "${options[@]}" update >&2
(cd debs && apt-get "${options[@]}" download apptainer libc6 libseccomp2 libsqlite3-0 >&2)
for deb in debs/*.deb; do dpkg-deb -x "$deb" root; done
rm -rf apt debs
root=$PWD/root
libraries=$root/usr/lib/x86_64-linux-gnu
loader=$(find "$root" -name 'ld-linux-x86-64.so.2' -not -type l | head -n 1)
# Both halves of Apptainer look for its configuration beside the folder that they lie in.
ln -sfn ../etc root/usr/etc
ln -sfn ../var root/usr/var
ln -sfn ../../etc root/usr/lib/etc
ln -sfn ../../var root/usr/lib/var
mkdir -p root/var/lib/apptainer/mnt/session
# Programs find the libraries that they were built for.
find "$root/usr/bin" "$root/usr/lib/x86_64-linux-gnu/apptainer" \
  -type f -perm -u+x | while read -r file; do
  patchelf --print-interpreter "$file" >/dev/null 2>&1 || continue
  patchelf --set-interpreter "$loader" --force-rpath --set-rpath "$libraries" "$file"
done
echo "$root/usr/bin/apptainer"
