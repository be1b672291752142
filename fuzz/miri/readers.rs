//! Reading of models that fuzzing found. Nothing is written, since Miri knows no owners of files.

use std::fs;
use std::path::Path;
use vbgs_studio::export::read_up_to;

#[test]
fn models_that_fuzzing_found_are_read_or_refused() {
    let mut n_files = 0;
    for target in ["ply", "compressed_ply", "splat"] {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../found").join(target);
        for file in fs::read_dir(folder).unwrap() {
            n_files += 1;
            match read_up_to(&file.unwrap().path(), 2000) {
                Ok(model) => assert!(!model.splats.is_empty()),
                Err(error) => assert!(error.to_string().len() < 1000),
            }
        }
    }
    assert!(n_files > 0, "nothing was found");
}
