//! Readers of models on inputs that fuzzing found.

#[path = "../entries/models.rs"]
mod models;

use std::fs;
use std::path::Path;

fn replay(target: &str, run: fn(&[u8])) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../found").join(target);
    for file in fs::read_dir(folder).unwrap() {
        run(&fs::read(file.unwrap().path()).unwrap());
    }
}

#[test]
fn models_that_fuzzing_found_are_read() {
    replay("ply", models::ply);
    replay("compressed_ply", models::ply);
    replay("splat", models::splat);
    models::spz(b"NGSP\x02\0\0\0\xff\xff\xff\xff\0\x0c\0\0");
    models::glb(b"glTF\x02\0\0\0\0\0\0\0\xff\xff\xff\xffJSON{\"asset\":");
}
