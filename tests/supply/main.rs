//! Supply chain: every dependency comes from crates.io under a licence that `deny.toml` allows, and
//! no build script fetches more. Uses `cargo metadata` offline.
#![allow(clippy::unwrap_used)]

mod licence;

use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::Command;
use std::sync::LazyLock;

const REGISTRY: &str = "registry+https://github.com/rust-lang/crates.io-index";

fn text(file: &str) -> String {
    fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(file)).unwrap()
}

/// Strings of a list in `deny.toml` that begins with `name = [` on its own line.
fn listed(name: &str) -> Vec<String> {
    let config = text("deny.toml");
    let (_, list) = config.split_once(&format!("\n{name} = [\n")).unwrap();
    let lines = list.split_once("\n]").unwrap().0.lines();
    lines.map(|line| line.split('"').nth(1).unwrap().to_owned()).collect()
}

/// Cargo's metadata of the packages in a build on this machine, with all features.
fn metadata() -> &'static Value {
    static SAID: LazyLock<Value> = LazyLock::new(ask_cargo);
    &SAID
}

fn ask_cargo() -> Value {
    let cargo = option_env!("CARGO").unwrap_or("cargo");
    let output = Command::new(cargo)
        .args(["metadata", "--offline", "--locked", "--format-version", "1", "--all-features"])
        // Packages of other systems may not be downloaded.
        .args(["--filter-platform", "host-tuple"])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn packages(metadata: &Value) -> &[Value] {
    let packages = metadata["packages"].as_array().unwrap();
    assert!(packages.len() > 100, "only {} packages", packages.len());
    packages
}

/// The program, and the engine as a Python package.
const OURS: [&str; 2] = ["vbgs-studio", "vbgs-studio-python"];

/// The lock file holds the packages of all systems, the metadata those of this one.
#[test]
fn every_dependency_comes_from_the_registry() {
    let lock = text("Cargo.lock");
    let entries: Vec<&str> = lock.split("[[package]]").skip(1).collect();
    assert!(entries.len() > 100, "only {} packages", entries.len());
    for entry in entries {
        let is_ours = OURS.iter().any(|name| entry.contains(&format!("\nname = \"{name}\"\n")));
        let is_registered = entry.contains(&format!("\nsource = \"{REGISTRY}\"\nchecksum = \""));
        assert!(is_ours || is_registered, "not from crates.io:{entry}");
    }
    for package in packages(metadata()) {
        let is_ours = OURS.iter().any(|name| package["name"] == *name);
        assert!(
            is_ours || package["source"] == REGISTRY,
            "{} {}",
            package["id"],
            package["source"]
        );
    }
}

#[test]
fn every_dependency_has_an_allowed_licence() {
    let allowed = listed("allow");
    let mut used = BTreeSet::new();
    for package in packages(metadata()) {
        let (name, expression) = (&package["name"], package["license"].as_str());
        let expression = expression.unwrap_or_else(|| panic!("{name}: no licence expression"));
        let verdict = licence::is_allowed(expression, &allowed);
        assert_eq!(verdict, Ok(true), "{name}: {expression} is not in deny.toml");
        used.extend(allowed.iter().filter(|licence| expression.contains(licence.as_str())));
    }
    let unused: Vec<_> = allowed.iter().filter(|licence| !used.contains(licence)).collect();
    assert!(unused.is_empty(), "deny.toml allows unused licences: {unused:?}");
}

#[test]
fn nothing_is_fetched_while_it_builds() {
    let packages: BTreeMap<&str, &Value> =
        packages(metadata()).iter().map(|p| (p["id"].as_str().unwrap(), p)).collect();
    let banned = listed("deny");
    for package in packages.values() {
        let name = package["name"].as_str().unwrap();
        assert!(!banned.iter().any(|banned| banned == name), "{name} is a network library");
    }
    let mut n_scripts = 0;
    for (id, package) in &packages {
        let targets = package["targets"].as_array().unwrap().iter();
        for script in targets.filter(|target| target["kind"][0] == "custom-build") {
            n_scripts += 1;
            let source = fs::read_to_string(script["src_path"].as_str().unwrap()).unwrap();
            for word in ["TcpStream", "\"curl\"", "\"wget\"", "\"git\"", "\"powershell\""] {
                assert!(!source.contains(word), "{id}: its build script contains {word}");
            }
        }
    }
    assert!(n_scripts > 10, "only {n_scripts} build scripts");
}
