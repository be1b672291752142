//! Splits a checkpoint into sections without the crate's reader, to edit it and restore its checksums.

/// One entry of the table and its content.
#[derive(Clone)]
pub struct RawSection {
    pub tag: [u8; 4],
    pub element: u32,
    pub content: Vec<u8>,
}

/// Sections of a valid file.
pub fn sections(bytes: &[u8]) -> Vec<RawSection> {
    let u32_at = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    let u64_at = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    (0..u32_at(12) as usize)
        .map(|i| {
            let entry = 24 + 32 * i;
            let (offset, length) = (u64_at(entry + 8), u64_at(entry + 16));
            RawSection {
                tag: bytes[entry..entry + 4].try_into().unwrap(),
                element: u32_at(entry + 4),
                content: bytes[offset..offset + length].to_vec(),
            }
        })
        .collect()
}

/// Builds a file from sections, with valid checksums.
pub fn file(sections: &[RawSection], version: (u16, u16)) -> Vec<u8> {
    let table_end = 24 + 32 * sections.len();
    let mut end = table_end + 4;
    let mut table = Vec::new();
    let mut body = Vec::new();
    for section in sections {
        let offset = end.next_multiple_of(64);
        body.resize(offset - table_end - 4, 0);
        body.extend_from_slice(&section.content);
        end = offset + section.content.len();
        table.extend_from_slice(&section.tag);
        table.extend_from_slice(&section.element.to_le_bytes());
        table.extend_from_slice(&(offset as u64).to_le_bytes());
        table.extend_from_slice(&(section.content.len() as u64).to_le_bytes());
        table.extend_from_slice(&crc32fast::hash(&section.content).to_le_bytes());
        table.extend_from_slice(&[0; 4]);
    }
    let mut bytes = b"\x89VBGS\r\n\x1a".to_vec();
    bytes.extend_from_slice(&version.0.to_le_bytes());
    bytes.extend_from_slice(&version.1.to_le_bytes());
    bytes.extend_from_slice(&(sections.len() as u32).to_le_bytes());
    bytes.extend_from_slice(&(end as u64).to_le_bytes());
    bytes.extend_from_slice(&table);
    bytes.extend_from_slice(&crc32fast::hash(&bytes).to_le_bytes());
    bytes.extend_from_slice(&body);
    bytes
}

/// Edits one section of a file; checksums stay valid.
pub fn edited(bytes: &[u8], tag: &[u8; 4], edit: impl FnOnce(&mut RawSection)) -> Vec<u8> {
    let mut sections = sections(bytes);
    edit(sections.iter_mut().find(|s| s.tag == *tag).unwrap());
    file(&sections, (1, 0))
}

/// Replaces bytes of the header or table; the table's checksum stays valid.
pub fn resealed(bytes: &[u8], at: usize, with: &[u8]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    bytes[at..at + with.len()].copy_from_slice(with);
    let n = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let table_end = 24 + 32 * n;
    if table_end + 4 <= bytes.len() {
        let crc = crc32fast::hash(&bytes[..table_end]);
        bytes[table_end..table_end + 4].copy_from_slice(&crc.to_le_bytes());
    }
    bytes
}
