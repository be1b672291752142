//! A list in pieces, for threads that fill one each.

/// A list in pieces of so many, which it holds.
pub fn pieces<T>(list: &mut [T], sizes: impl Iterator<Item = usize>) -> Vec<&mut [T]> {
    let mut rest = list;
    sizes.map(|size| rest.split_off_mut(..size).unwrap_or_default()).collect()
}
