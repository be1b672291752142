//! A list in runs, for threads that take one each.

/// The runs that begin at some places, ascending: the first at 0, the last ends with the list. Each with the
/// place that it begins at.
pub fn runs<'a, T>(mut list: &'a mut [T], firsts: &[usize]) -> Vec<(usize, &'a mut [T])> {
    let mut runs = Vec::with_capacity(firsts.len());
    for &first in firsts.iter().rev() {
        let (before, run) = list.split_at_mut(first.min(list.len()));
        runs.push((first, run));
        list = before;
    }
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_cover_a_list() {
        let mut list = [0, 1, 2, 3, 4, 5];
        let found: Vec<(usize, Vec<i32>)> =
            runs(&mut list, &[0, 2, 5]).into_iter().map(|(at, run)| (at, run.to_vec())).collect();
        assert_eq!(found, [(5, vec![5]), (2, vec![2, 3, 4]), (0, vec![0, 1])]);
        assert!(runs(&mut [0; 0], &[0]).iter().all(|(_, run)| run.is_empty()));
    }
}
