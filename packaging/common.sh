# Shared by the scripts of this folder: builds the program unless `BINARY` names it, and lays out what a system installs.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
version="$(sed -n 's/^version = "\(.*\)"$/\1/p' Cargo.toml | head -n 1)"
export SOURCE_DATE_EPOCH="${SOURCE_DATE_EPOCH:-$(git log -1 --format=%ct)}"
out="${OUT_DIR:-target/packages}"
if [ -z "${BINARY:-}" ]; then
    cargo build --release --locked --bin vbgs-studio
    BINARY="${CARGO_TARGET_DIR:-target}/release/vbgs-studio"
fi
mkdir -p "$out"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT

# Writes manual pages and completions into $work/manual.
manual() {
    mkdir -p "$work/manual"
    "$BINARY" manual "$work/manual"
}

# Fills the folder $1 with the files below /usr.
install_tree() {
    local usr="$1" size
    manual
    install -Dm755 "$BINARY" "$usr/bin/vbgs-studio"
    install -Dm644 assets/vbgs-studio.desktop "$usr/share/applications/vbgs-studio.desktop"
    install -Dm644 assets/icon.svg "$usr/share/icons/hicolor/scalable/apps/vbgs-studio.svg"
    size="$(od -An -t u1 -j 18 -N 2 assets/icon.png | awk '{ print $1 * 256 + $2 }')"
    install -Dm644 assets/icon.png "$usr/share/icons/hicolor/${size}x${size}/apps/vbgs-studio.png"
    install -Dm644 packaging/vbgs-studio.xml "$usr/share/mime/packages/vbgs-studio.xml"
    install -Dm644 packaging/vbgs-studio.metainfo.xml "$usr/share/metainfo/vbgs-studio.metainfo.xml"
    for page in "$work"/manual/*.1; do
        install -d "$usr/share/man/man1"
        gzip -9n <"$page" >"$usr/share/man/man1/$(basename "$page").gz"
    done
    install -Dm644 "$work/manual/vbgs-studio.bash" "$usr/share/bash-completion/completions/vbgs-studio"
    install -Dm644 "$work/manual/_vbgs-studio" "$usr/share/zsh/vendor-completions/_vbgs-studio"
    install -Dm644 "$work/manual/vbgs-studio.fish" "$usr/share/fish/vendor_completions.d/vbgs-studio.fish"
    for file in README.md CHANGELOG.md LICENSE-MIT LICENSE-APACHE assets/icons.LICENSE; do
        install -Dm644 "$file" "$usr/share/doc/vbgs-studio/$file"
    done
}
