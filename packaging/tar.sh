#!/usr/bin/env bash
# Makes an archive of the program with its checksum, for any distribution and for `cargo binstall`.
. "$(dirname "$0")/common.sh"
target="${TARGET:-$(rustc -vV | sed -n 's/^host: //p')}"
name="vbgs-studio-$version-$target"
manual
mkdir -p "$work/$name/completions" "$work/$name/man"
install -m755 "$BINARY" "$work/$name/vbgs-studio"
install -m644 README.md CHANGELOG.md LICENSE-MIT LICENSE-APACHE assets/icons.LICENSE assets/vbgs-studio.desktop assets/icon.svg \
    packaging/vbgs-studio.xml packaging/vbgs-studio.metainfo.xml "$work/$name"
mv "$work"/manual/*.1 "$work/$name/man"
mv "$work"/manual/* "$work/$name/completions"
# The same content gives the same bytes.
tar --sort=name --owner=0 --group=0 --numeric-owner --mtime="@$SOURCE_DATE_EPOCH" -C "$work" -cf - "$name" |
    gzip -9n >"$out/$name.tar.gz"
(cd "$out" && sha256sum "$name.tar.gz" >"$name.tar.gz.sha256")
echo "$out/$name.tar.gz"
