//! Splits a slice into disjoint parts, one per thread.

/// Splits a slice into consecutive parts of the given sizes. Parts past the end are empty.
pub fn split_by_sizes<T>(list: &mut [T], sizes: impl Iterator<Item = usize>) -> Vec<&mut [T]> {
    let mut rest = list;
    sizes.map(|size| rest.split_off_mut(..size).unwrap_or_default()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_as_long_as_asked_while_the_list_lasts() {
        let mut list = [0, 1, 2, 3, 4];
        assert_eq!(
            split_by_sizes(&mut list, [2, 0, 3].into_iter()),
            [&[0, 1][..], &[], &[2, 3, 4]]
        );
        assert_eq!(split_by_sizes(&mut list, [3, 3, 1].into_iter()), [&[0, 1, 2][..], &[], &[3]]);
    }
}
