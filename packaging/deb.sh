#!/usr/bin/env bash
# Makes a Debian package of the program: `packaging/deb.sh`, or `BINARY=FILE packaging/deb.sh` of a built one.
. "$(dirname "$0")/common.sh"
root="$work/root"
install_tree "$root/usr"
cat >"$root/usr/share/doc/vbgs-studio/copyright" <<'TEXT'
Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/
Upstream-Name: vbgs-studio

Files: *
Copyright: The authors of vbgs-studio
License: MIT or Apache-2.0
Comment: The texts are in LICENSE-MIT and LICENSE-APACHE beside this file.
TEXT
architecture="$(dpkg --print-architecture)"
mkdir -p "$root/DEBIAN"
# A window loads its libraries when it opens; without them the commands still run.
cat >"$root/DEBIAN/control" <<TEXT
Package: vbgs-studio
Version: $version
Architecture: $architecture
Maintainer: The authors of vbgs-studio <maintainers@users.noreply.invalid>
Installed-Size: $(du -sk "$root/usr" | cut -f 1)
Depends: libc6 (>= 2.34), libgcc-s1
Recommends: libvulkan1, libxkbcommon0, libwayland-client0 | libx11-6, libxkbcommon-x11-0, libxcursor1, libxi6
Suggests: mesa-vulkan-drivers, ffmpeg
Section: graphics
Priority: optional
Description: reconstruction of scenes from posed RGB-D frames
 Turns photographs with depth and poses into a Gaussian-splat scene while it is watched, in closed form by
 variational Bayes. Opens captures of phones and depth cameras; writes PLY, GLB, SPZ, SOG, USD, meshes and web pages.
TEXT
(cd "$root" && find usr -type f -print0 | sort -z | xargs -0 md5sum) >"$root/DEBIAN/md5sums"
find "$root" -exec touch -h -d "@$SOURCE_DATE_EPOCH" {} +
package="$out/vbgs-studio_${version}_$architecture.deb"
dpkg-deb --root-owner-group -Zxz --build "$root" "$package" >/dev/null
echo "$package"
