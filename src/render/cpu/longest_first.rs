//! Parallel scheduling of tasks with very different durations.

use std::sync::{Mutex, PoisonError};

/// Runs tasks in parallel, largest work estimate first. Only short tasks remain at the end, so threads
/// finish at about the same time.
pub(super) fn longest_first<T: Send>(
    tasks: impl Iterator<Item = (usize, T)>,
    run: impl Fn(T) + Sync,
) {
    let mut tasks: Vec<(usize, T)> = tasks.collect();
    tasks.sort_by_key(|(work, _)| *work);
    let tasks = Mutex::new(tasks);
    let next = || tasks.lock().unwrap_or_else(PoisonError::into_inner).pop();
    rayon::scope(|scope| {
        for _ in 0..rayon::current_num_threads() {
            scope.spawn(|_| {
                while let Some((_, task)) = next() {
                    run(task);
                }
            });
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_task_runs_once_and_the_longest_first() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let ran = Mutex::new(Vec::new());
        let tasks = [3, 0, 7, 7, 1].into_iter().map(|work| (work, work));
        pool.install(|| longest_first(tasks, |task| ran.lock().unwrap().push(task)));
        assert_eq!(*ran.lock().unwrap(), [7, 7, 3, 1, 0]);
    }
}
