//! Checkpoints with correct checksums and arbitrary content.

use vbgs_studio::export::checkpoint::{parse, to_bytes};
use vbgs_studio::pipeline::checkpoint::SavedRun;

const HEADER: usize = 24;
const ENTRY: usize = 32;

/// Parses a checkpoint, writes it again, reads it as a run and renders it.
pub fn checkpoint(data: &[u8]) {
    let data = sealed(data);
    let Ok(loaded) = parse(&data) else { return };
    let again = parse(&to_bytes(&loaded.checkpoint)).expect("what is written can be read");
    // By their bytes, because NaN is not equal to itself.
    assert_eq!(to_bytes(&again.checkpoint), to_bytes(&loaded.checkpoint));
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("checkpoint.vbgs");
    std::fs::write(&path, &data).expect("a file");
    let Ok(run) = SavedRun::read(&path) else { return };
    let _ = run.trajectory();
    assert!(run.up().is_finite());
    if let Ok(splats) = run.splats() {
        let drawn = splats.iter().filter(|splat| splat.opacity > 0.0);
        drawn.for_each(|splat| assert!(splat.is_valid(), "{splat:?}"));
    }
}

/// Returns the file with correct checksums, as far as its table gives the places of the sections.
pub fn sealed(data: &[u8]) -> Vec<u8> {
    let mut data = data.to_vec();
    let at = |data: &[u8], place: usize| {
        let bytes = data.get(place..place + 8)?.first_chunk()?;
        usize::try_from(u64::from_le_bytes(*bytes)).ok()
    };
    let Some(count) = data.get(12..16).and_then(|bytes| bytes.first_chunk()) else { return data };
    let count = (u32::from_le_bytes(*count) as usize).min(64);
    for entry in (0..count).map(|i| HEADER + ENTRY * i) {
        let (Some(offset), Some(length)) = (at(&data, entry + 8), at(&data, entry + 16)) else {
            return data;
        };
        let Some(content) = offset.checked_add(length).and_then(|end| data.get(offset..end)) else {
            continue;
        };
        let crc = crc32fast::hash(content).to_le_bytes();
        if let Some(place) = data.get_mut(entry + 24..entry + 28) {
            place.copy_from_slice(&crc);
        }
    }
    let end = HEADER + ENTRY * count;
    let crc = crc32fast::hash(data.get(..end).unwrap_or_default()).to_le_bytes();
    if let Some(place) = data.get_mut(end..end + 4) {
        place.copy_from_slice(&crc);
    }
    data
}
