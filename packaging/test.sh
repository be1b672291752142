#!/usr/bin/env bash
# Installs a package into an empty root and checks what a user gets: `packaging/test.sh PACKAGE.deb`. Needs root.
#
# The root has nothing but the package's files and the C library of this system. With a display (`xvfb-run`), the
# command of a double click opens the scene in `SCENE`.
set -euo pipefail
package="$(realpath "$1")"
root="$(mktemp -d)"
trap 'rm -rf "$root"' EXIT
mkdir -p "$root"/var/lib/dpkg/{info,updates,triggers} "$root/tmp"
touch "$root/var/lib/dpkg/"{status,available}
# Dependencies are not packages here: their files are copied below.
dpkg --root="$root" --force-depends --force-script-chrootless --install "$package" >/dev/null
grep -q "^Status: install ok installed" "$root/var/lib/dpkg/status"
mkdir -p "$root"/lib64 "$root/lib"
for library in $(ldd "$root/usr/bin/vbgs-studio" | grep -o '/[^ ]*'); do
    install -D "$library" "$root$library"
done
chroot "$root" /usr/bin/vbgs-studio --version
chroot "$root" /usr/bin/vbgs-studio export --help >/dev/null
(cd "$root" && md5sum --quiet -c var/lib/dpkg/info/vbgs-studio.md5sums)

applications="$root/usr/share/applications"
if command -v desktop-file-validate >/dev/null; then
    desktop-file-validate "$applications/vbgs-studio.desktop"
fi
if command -v appstreamcli >/dev/null; then
    # The project has no domain yet, of which the identifier could be made.
    appstreamcli validate --no-net --override=cid-desktopapp-is-not-rdns=info "$root/usr/share/metainfo/vbgs-studio.metainfo.xml"
fi
# Every type of the desktop file is one of the system or of the package.
update-mime-database "$root/usr/share/mime"
types="$(sed -n 's/^MimeType=//p' "$applications/vbgs-studio.desktop" | tr ';' '\n')"
for type in $types; do
    grep -qs "\"$type\"" "$root/usr/share/mime/packages/vbgs-studio.xml" ||
        { echo "error: $type is not declared" >&2; exit 1; }
done
if [ -n "${SCENE:-}" ]; then
    # The command of a double click, as a desktop runs it; the time limit ends the window.
    command="$(sed -n 's/^Exec=//p' "$applications/vbgs-studio.desktop")"
    command="${command/\%f/$SCENE}"
    status=0
    PATH="$root/usr/bin:$PATH" timeout -s TERM "${SECONDS_OPEN:-20}" $command || status=$?
    # The window was open until the time limit.
    [ "$status" -eq 124 ] || { echo "error: \`$command\` ended with status $status" >&2; exit 1; }
    echo "\`$command\` opened a window"
fi
echo "the package is good"
