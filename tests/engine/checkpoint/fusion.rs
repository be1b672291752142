//! Scenes with seeds that went on from one scene with different frames, as one.

use super::*;
use vbgs_studio::export::checkpoint::StoredModel;
use vbgs_studio::model::scene::state::{QUANTUM, SceneState, StoredSums};
use vbgs_studio::pipeline::checkpoint::{RunError, merge, merge_onto};
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::train::scene::config::BirthRule;
use vbgs_studio::train::scene::photometric::rule::PhotometricMode;
use vbgs_studio::train::scene::units::Budget;

fn asked(photometric: PhotometricMode) -> SceneOverrides {
    SceneOverrides { photometric: Some(photometric), ..SceneOverrides::default() }
}

fn scene(run: &SavedRun) -> &SceneState {
    let StoredModel::Scene(state) = &run.content.model else { unreachable!() };
    state
}

/// A start, and what each of `n` shards made of it.
fn shards(asked: &SceneOverrides, n: usize) -> (SavedRun, Vec<SavedRun>) {
    let start = saved(&trained(asked, shard("1/8")));
    let shard = |k| {
        let request =
            ResumeRequest { shard: format!("{k}/{n}").parse().ok(), ..ResumeRequest::default() };
        saved(&finished(start.clone().resume(room(), &request, false).unwrap()))
    };
    let shards = (1..=n).map(shard).collect();
    (start, shards)
}

fn count(state: &SceneState, id: usize) -> f64 {
    let StoredSums::Mixed { rows, wide } = &state.sums else { unreachable!() };
    let wide = wide.iter().find(|row| row.id as usize == id);
    wide.map_or(f64::from(rows[id][0]) * QUANTUM, |row| row.sums[0])
}

fn points(state: &SceneState) -> f64 {
    (0..state.visibility.len()).map(|id| count(state, id)).sum()
}

#[test]
fn a_fused_scene_keeps_to_the_budget() {
    let free = asked(PhotometricMode::Off);
    let (start, shards) = shards(&free, 2);
    let n = shards.iter().map(|run| scene(run).seeds.len()).max().unwrap();
    let union = merge_onto(&start, shards.clone()).unwrap().unwrap();
    assert!(scene(&union).seeds.len() > n, "the shards see other places");
    let budget = Some(Budget::Components(n));
    let held = SceneOverrides { budget, ..free };
    let (start, shards) = self::shards(&held, 2);
    let all = reread(&merge_onto(&start, shards.clone()).unwrap().unwrap());
    let used = all.revive().unwrap().learner.used();
    assert!(used <= n, "{used} of {n}");
    assert_eq!(points(scene(&all)), points(scene(&union)));
}

#[test]
fn scenes_that_began_apart_do_not_cover_surfaces_twice() {
    let asked = asked(PhotometricMode::Off);
    let runs = ["1/2", "2/2"].map(|part| saved(&trained(&asked, shard(part))));
    let all = reread(&merge(runs.to_vec()).unwrap().unwrap());
    let sizes = runs.each_ref().map(|run| scene(run).seeds.len());
    let n = scene(&all).seeds.len();
    assert!(n >= sizes[0] && n < sizes[0] + sizes[1] / 2, "{n} of {sizes:?}");
    assert_eq!(points(scene(&all)), points(scene(&runs[0])) + points(scene(&runs[1])));
}

#[test]
fn runs_that_did_not_go_on_from_the_start_are_refused() {
    let asked = asked(PhotometricMode::Off);
    let (start, shards) = shards(&asked, 2);
    let refused = |start: &SavedRun, run: SavedRun, part: &str| {
        let error = merge_onto(start, vec![shards[0].clone(), run]).unwrap_err();
        assert!(error.to_string().contains(part), "{part} is missing in: {error}");
    };
    refused(&start, saved(&trained(&asked, shard("2/2"))), "found other frames at its beginning");
    refused(&start, shards[0].clone(), "expected no frame in both");
    let with = |change: &dyn Fn(&mut SceneState)| {
        let mut run = shards[1].clone();
        let StoredModel::Scene(state) = &mut run.content.model else { unreachable!() };
        change(state);
        run
    };
    refused(&start, with(&|scene| scene.seeds[0][0] += 1.0), "found other components");
    let shared = |scene: &mut SceneState| {
        scene.components = Some((0..scene.seeds.len() as u32).collect());
    };
    refused(&start, with(&shared), "merged as its budget was reached");
    let lattice = SceneOverrides { births: Some(BirthRule::Lattice), ..asked };
    let one = saved(&trained(&lattice, shard("1/8")));
    let error = merge_onto(&one, vec![one.clone()]).unwrap_err();
    assert!(matches!(error, RunError::Origin { .. }), "{error}");
    let twice = merge(shards.clone()).unwrap_err().to_string();
    assert!(twice.contains("--start"), "{twice}");
}
