//! Merging mixtures trained on different frames.

use super::*;
use vbgs_studio::export::checkpoint::StoredModel;
use vbgs_studio::model::paper::state::{Carry, Totals};
use vbgs_studio::pipeline::checkpoint::{RunError, merge};
use vbgs_studio::train::paper::config::Init;

fn message(runs: Vec<SavedRun>) -> String {
    merge(runs).unwrap_err().to_string()
}

#[test]
fn merged_shards_are_the_run_over_all_frames() {
    for (init, precision) in [
        (Init::Random, Precision::Mixed),
        (Init::Random, Precision::F64),
        (Init::Data, Precision::Mixed),
    ] {
        let overrides = PaperOverrides { init: Some(init), ..PaperOverrides::default() };
        let config = config(ReassignPolicy::Off, precision).with(&overrides).unwrap();
        let whole = trained(&config, Selection::all_frames());
        let (expected, scene) = (whole.checkpoint().unwrap(), ply(&whole));
        for n in [2, 3, 5] {
            let mut runs: Vec<_> =
                (1..=n).map(|k| saved(&trained(&config, shard(&format!("{k}/{n}"))))).collect();
            runs.rotate_left(1);
            // Merges form a tree, not a chain.
            let rest = reread(&merge(runs.split_off(n / 2)).unwrap().unwrap());
            runs.push(rest);
            let merged = reread(&merge(runs).unwrap().unwrap());
            assert!(merged.content.model == expected.model, "{n} shards");
            assert_eq!(merged.content.cursor.frames, expected.cursor.frames);
            assert_eq!(merged.content.cursor.points, expected.cursor.points);
            assert_eq!(merged.config, *whole.config());
            let resumed = merged.resume(room(), &ResumeRequest::default(), false).unwrap();
            assert!(ply(&finished(resumed)) == scene, "{n} shards");
        }
    }
}

#[test]
fn a_merged_run_goes_on_with_the_frames_that_are_missing() {
    let whole = trained(&off(), Selection::all_frames());
    let runs = ["3/3", "1/3"].map(|s| saved(&trained(&off(), shard(s)))).to_vec();
    let merged = merge(runs).unwrap().unwrap();
    let session = merged.resume(room(), &ResumeRequest::default(), false).unwrap();
    let (visited, frames) = (session.visited(), session.plan().frames.clone());
    assert_eq!(frames.len(), FRAMES);
    assert_eq!(frames[visited..], (1..FRAMES).step_by(3).collect::<Vec<_>>());
    assert!(ply(&finished(session)) == ply(&whole));
}

#[test]
fn shards_share_all_frames() {
    let config = off();
    let plan = |text: &str| {
        Session::new(room(), config.clone(), shard(text)).unwrap().plan().frames.clone()
    };
    assert_eq!(plan("1/1"), (0..FRAMES).collect::<Vec<_>>());
    assert_eq!(plan("2/3"), (1..FRAMES).step_by(3).collect::<Vec<_>>());
    let mut all: Vec<usize> = (1..=7).flat_map(|k| plan(&format!("{k}/7"))).collect();
    all.sort_unstable();
    assert_eq!(all, plan("1/1"));
    let few = Selection { stride: 3, max_frames: Some(2), ..shard("2/2") };
    let plan = Session::new(room(), config, few).unwrap().plan().frames.clone();
    assert_eq!(plan, [3, 9], "the stride applies first, then the shard, then the limit on frames");
    for text in ["0/2", "3/2", "1", "1/0", "-1/2", "a/b", "1/2/3", ""] {
        let error = text.parse::<vbgs_studio::pipeline::plan::Shard>().unwrap_err();
        assert!(error.contains("expected K/N") && error.contains(text), "{error}");
    }
}

#[test]
fn models_that_began_apart_are_refused() {
    let base = saved(&trained(&off(), shard("1/2")));
    let other = |config: &PaperConfig| saved(&trained(config, shard("2/2")));
    let with = |overrides: PaperOverrides| other(&off().with(&overrides).unwrap());
    let seed = with(PaperOverrides { seed: Some(9), ..PaperOverrides::default() });
    let said = message(vec![base.clone(), seed]);
    assert!(said.contains("setting `seed`") && said.contains("0 and 9"), "{said}");
    let precise = other(&config(ReassignPolicy::Off, Precision::F64));
    let said = message(vec![base.clone(), precise]);
    assert!(said.contains("expected the same setting `operations`"), "{said}");
    let longer = Session::new(room_of(FRAMES + 1, 4), off(), shard("2/2")).unwrap();
    let said = message(vec![base, saved(&longer)]);
    assert!(said.contains("same dataset") && said.contains("number of frames"), "{said}");
}

#[test]
fn reassignment_parts_the_models() {
    let config = config(ReassignPolicy::Padded, Precision::Mixed);
    let runs = ["1/2", "2/2"].map(|s| saved(&trained(&config, shard(s)))).to_vec();
    let said = message(runs);
    for part in ["the same initial means", "component", "reassign=off"] {
        assert!(said.contains(part), "{part:?} is missing in: {said}");
    }
}

#[test]
fn no_frame_counts_twice() {
    let [a, b] = ["1/2", "1/4"].map(|s| saved(&trained(&off(), shard(s))));
    let said = message(vec![a.clone(), b]);
    assert!(said.contains("expected no frame in both, found 10, the first 0"), "{said}");
    let said = message(vec![a.clone(), a]);
    assert!(said.contains("found 20"), "{said}");
}

#[test]
fn totals_that_overflow_do_not_add() {
    let [mut a, mut b] = ["1/2", "2/2"].map(|s| saved(&trained(&off(), shard(s))));
    for run in [&mut a, &mut b] {
        let StoredModel::Mixture { state, .. } = &mut run.content.model else { unreachable!() };
        let Totals::Fixed64 { carries, .. } = &mut state.totals else { unreachable!() };
        carries.clear();
        carries.push(Carry { id: 0, limbs: [i32::MAX; 13] });
    }
    let error = merge(vec![a, b]).unwrap_err();
    assert!(matches!(error, RunError::Add { .. }));
    assert!(error.to_string().contains("exceeds the range"), "{error}");
    assert!(merge(Vec::new()).unwrap().is_none());
}
