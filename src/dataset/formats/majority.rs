//! Majority vote over a recording's files, such as the size of the camera or the format of depth.
//!
//! One camera took all frames, so a deviating frame is faulty. The first frame may be the faulty one, hence
//! a vote. Only a sample of files is read, which is fast for thousands of frames and enough for a majority.

/// Number of evenly spaced files that are read.
const SAMPLED_FILES: usize = 9;

/// Most frequent value among the sampled files; of equally frequent values the first file's. `None` without
/// files.
///
/// # Errors
/// The first error if no file can be read.
pub(super) fn majority<S, T: Copy + PartialEq, E>(
    files: &[S],
    ask: impl Fn(&S) -> Result<T, E>,
) -> Result<Option<T>, E> {
    let n = files.len().min(SAMPLED_FILES);
    let is_asked = |(at, _): &(usize, &S)| (0..n).any(|i| i * files.len() / n == *at);
    let (mut answers, mut error) = (Vec::new(), None);
    // Retried once: a passing disk error would change the result for all frames silently.
    let ask = |file: &S| ask(file).or_else(|_| ask(file));
    let mut note = |answer: Result<T, E>| match answer {
        Ok(answer) => answers.push(answer),
        Err(e) => drop(error.get_or_insert(e)),
    };
    files.iter().enumerate().filter(is_asked).for_each(|(_, file)| note(ask(file)));
    // If no sampled file is readable, any other one decides: damaged images must not cost the recording.
    let mut others = files.iter().enumerate().filter(|file| !is_asked(file));
    let n_votes = |answer: &T| answers.iter().filter(|other| *other == answer).count();
    let mut most: Option<T> = None;
    for answer in &answers {
        if most.is_none_or(|most| n_votes(answer) > n_votes(&most)) {
            most = Some(*answer);
        }
    }
    match most.or_else(|| others.find_map(|(_, file)| ask(file).ok())) {
        Some(answer) => Ok(Some(answer)),
        None => error.map_or(Ok(None), Err),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn most(files: &[Option<u32>]) -> Result<Option<u32>, &'static str> {
        majority(files, |file| file.ok_or("damaged"))
    }

    #[test]
    fn the_odd_one_is_outvoted_wherever_it_stands() {
        for odd in 0..4 {
            let mut files = [Some(7); 4];
            files[odd] = Some(5);
            assert_eq!(most(&files), Ok(Some(7)), "{odd}");
        }
        assert_eq!(most(&[Some(5), Some(7)]), Ok(Some(5)), "as many of each");
        assert_eq!(most(&[]), Ok(None));
        assert_eq!(most(&[None, None]), Err("damaged"));
        assert_eq!(most(&[None, Some(5), Some(7), Some(7)]), Ok(Some(7)));
    }

    #[test]
    fn a_file_that_can_be_read_is_found_among_many_that_cannot() {
        let mut files = [None; 100];
        files[1] = Some(7);
        assert_eq!(most(&files), Ok(Some(7)));
    }
}
