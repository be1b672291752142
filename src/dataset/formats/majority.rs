//! What most of a recording's files say: a camera of one size, depth of one kind.
//!
//! One camera took all frames, so what a frame says otherwise is wrong with that frame. Which frame it
//! is cannot be told by the first one, which is as likely odd as any other. Not all files are asked:
//! opening a recording of thousands must stay quick, and an odd frame among some is not a majority.

/// Files asked, evenly spaced.
const ASKED: usize = 9;

/// What most files say, of those asked; of answers equally frequent that of the first file. `None` if
/// there are no files.
///
/// # Errors
/// The first error if no file says anything.
pub(super) fn of_most<S, T: Copy + PartialEq, E>(
    files: &[S],
    ask: impl Fn(&S) -> Result<T, E>,
) -> Result<Option<T>, E> {
    let n = files.len().min(ASKED);
    let is_asked = |(at, _): &(usize, &S)| (0..n).any(|i| i * files.len() / n == *at);
    let (mut answers, mut error) = (Vec::new(), None);
    // Twice: by what a disk refuses once all frames would be read otherwise, and nobody would be told.
    let ask = |file: &S| ask(file).or_else(|_| ask(file));
    let mut note = |answer: Result<T, E>| match answer {
        Ok(answer) => answers.push(answer),
        Err(e) => drop(error.get_or_insert(e)),
    };
    files.iter().enumerate().filter(is_asked).for_each(|(_, file)| note(ask(file)));
    // Others stand in where none of these can be read: damaged images must not cost the recording.
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
        of_most(files, |file| file.ok_or("damaged"))
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
