//! Fusion of scenes with seeds that resumed one start scene with different frames.

use super::*;
use glam::{DMat4, DQuat, DVec3};
use vbgs_studio::dataset::frame::{ColorBuffer, DepthBuffer, DepthKind, Frame};
use vbgs_studio::dataset::surface::{Preparer, Sensor, SurfaceSettings};
use vbgs_studio::export::checkpoint::StoredModel;
use vbgs_studio::math::camera::Intrinsics;
use vbgs_studio::model::scene::photometric::PhotometricDeviations;
use vbgs_studio::model::scene::state::{QUANTUM, SceneState, StoredSums};
use vbgs_studio::model::scene::texels::{Observed, TextureSums};
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::observation::surface::Observation;
use vbgs_studio::pipeline::checkpoint::{RunError, merge, merge_onto};
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::train::learner::{Learner, Learns};
use vbgs_studio::train::scene::config::SceneConfig;
use vbgs_studio::train::scene::fusion::fuse;
use vbgs_studio::train::scene::photometric::rule::{PhotometricMode, PhotometricRule};
use vbgs_studio::train::scene::trainer::SceneTrainer;
use vbgs_studio::train::scene::units::Budget;

fn asked(photometric: PhotometricMode) -> SceneOverrides {
    // The start and every shard hold buffered photographs.
    let shuffle_buffer = (photometric != PhotometricMode::Off).then_some(4);
    let photometric = Some(photometric);
    SceneOverrides { photometric, shuffle_buffer, ..SceneOverrides::default() }
}

fn scene(run: &SavedRun) -> &SceneState {
    let StoredModel::Scene(state) = &run.content.model else { unreachable!() };
    state
}

/// Trains a start scene and `n` shards that resume it.
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
    let StoredSums { rows, wide } = &state.sums;
    let wide = wide.iter().find(|row| row.id as usize == id);
    wide.map_or(f64::from(rows[id][0]) * QUANTUM, |row| row.sums[0])
}

fn points(state: &SceneState) -> f64 {
    (0..state.visibility.len()).map(|id| count(state, id)).sum()
}

/// Largest difference between the sums of two scenes, in quanta.
fn farthest(a: &StoredSums, b: &StoredSums) -> u32 {
    let pairs = a.rows.iter().flatten().zip(b.rows.iter().flatten());
    pairs.map(|(a, b)| a.abs_diff(*b)).max().unwrap()
}

#[test]
fn shards_of_one_start_are_as_one_run() {
    let asked = asked(PhotometricMode::Light);
    let (start, shards) = shards(&asked, 3);
    let mut all = reread(&merge_onto(&start, shards.clone()).unwrap().unwrap());
    let whole = saved(&trained(&asked, Selection::all_frames()));
    assert_eq!(all.content.cursor.frames, whole.content.cursor.frames);
    assert_eq!(all.content.cursor.points, whole.content.cursor.points);
    assert_eq!(all.config, whole.config);
    // Every point counts once, and no surface gets two layers of components.
    let (fused, one) = (scene(&all), scene(&whole));
    let added = shards.iter().map(|run| points(scene(run)) - points(scene(&start)));
    assert_eq!(points(fused), points(scene(&start)) + added.sum::<f64>());
    let (n, expected) = (fused.seeds.len() as f64, one.seeds.len() as f64);
    assert!((0.8..1.1).contains(&(n / expected)), "{n} components, {expected} of one run");
    // Colour estimates of the fused scene are at least as certain as those of any shard.
    let known = |run: &SavedRun, id| {
        let state = scene(run).photometric.as_ref().unwrap();
        PhotometricDeviations::of(state, id).map(|d| d.color)
    };
    // Splats still young in the start scene restart in every shard, so they are left out.
    let is_ripe = |id: usize| count(scene(&start), id) >= PhotometricRule::DEFAULT.young;
    let ids = (0..scene(&start).seeds.len()).filter(|&id| is_ripe(id) && known(&all, id).is_some());
    // Colour deviation of the fused scene relative to the smallest one of a shard.
    let ratio = |id: usize| {
        let sure = shards.iter().filter_map(|run| known(run, id)).fold(f64::INFINITY, f64::min);
        known(&all, id).unwrap() / sure
    };
    let mut ratios: Vec<f64> = ids.map(ratio).collect();
    ratios.sort_by(f64::total_cmp);
    // Every frame that shows a splat decays the evidence of the start scene; fusion applies the decay of all
    // shards. Where one shard saw nearly every frame, the decay can exceed what the others add.
    let surer = ratios.partition_point(|ratio| *ratio <= 1.001);
    assert!(ratios.len() > 20 && surer * 10 >= ratios.len() * 9, "{surer} of {}", ratios.len());
    assert!(ratios.last().is_some_and(|most| *most < 1.05), "{:?}", &ratios[surer..]);
    // The order of the shards does not matter.
    let mut others = shards;
    others.rotate_left(1);
    let again = reread(&merge_onto(&start, others).unwrap().unwrap());
    assert!(again.content.model == all.content.model);
    // The fused run resumes; no frame is left to train.
    all.path = start.path.clone();
    assert!(all.resume(room(), &ResumeRequest::default(), false).is_ok());
}

#[test]
fn a_shard_begins_with_the_settled_start() {
    let start = saved(&trained(&asked(PhotometricMode::Light), shard("1/8")));
    let waiting = |shard: &str| {
        let request = ResumeRequest { shard: shard.parse().ok(), ..ResumeRequest::default() };
        let resumed = saved(&start.clone().resume(room(), &request, false).unwrap());
        scene(&resumed).photometric.as_ref().unwrap().buffered.len()
    };
    // The start is complete, so the same part of the frames is one of what it left.
    assert_eq!((waiting("1/2"), waiting("1/8")), (0, 0));
    // A run that was interrupted continues with its buffer, as if it had not been.
    let mut session = Session::new(room(), asked(PhotometricMode::Light), shard("1/4")).unwrap();
    (0..5).for_each(|_| drop(session.step().unwrap()));
    let request = ResumeRequest { shard: "1/4".parse().ok(), ..ResumeRequest::default() };
    let resumed = saved(&saved(&session).resume(room(), &request, false).unwrap());
    assert_eq!(scene(&resumed).photometric.as_ref().unwrap().buffered.len(), 4);
    // Scenes that add nothing to their start leave it as it is, however many they are.
    let request = ResumeRequest { shard: "1/2".parse().ok(), ..ResumeRequest::default() };
    let settled = saved(&start.clone().resume(room(), &request, false).unwrap());
    let state = scene(&settled);
    let config = &settled.config.method.scene().unwrap().engine;
    let fused = fuse(config, Some(scene(&start)), &[state; 3]).unwrap();
    let splats = |state: &SceneState| state.photometric.clone().unwrap().splats;
    let pairs = splats(&fused).into_iter().zip(splats(state));
    let far = pairs.flat_map(|(a, b)| [0, 1, 2].map(|k| (a.color[k] - b.color[k]).abs()));
    assert!(far.fold(0.0f32, f32::max) < 1e-3);
}

#[test]
fn the_first_shard_of_a_start_trains_on_frames_that_the_start_left() {
    let asked = asked(PhotometricMode::Off);
    let start = saved(&trained(&asked, shard("1/4")));
    let visited = |k: usize| {
        let request =
            ResumeRequest { shard: format!("{k}/4").parse().ok(), ..ResumeRequest::default() };
        let run = saved(&finished(start.clone().resume(room(), &request, false).unwrap()));
        // Resumed by the same command, a complete shard has no frame left.
        let again = run.clone().resume(room(), &request, false).unwrap();
        assert_eq!(again.plan().frames.len(), run.content.cursor.visited.len());
        run.content.cursor.visited[start.content.cursor.visited.len()..].to_vec()
    };
    let shards: Vec<Vec<u32>> = (1..=4).map(visited).collect();
    let sizes = shards.iter().map(Vec::len);
    assert!(sizes.clone().max().unwrap() - sizes.min().unwrap() <= 1, "{shards:?}");
    let mut all = [start.content.cursor.visited.clone(), shards.concat()].concat();
    all.sort_unstable();
    assert_eq!(all, (0..FRAMES as u32).collect::<Vec<_>>());
}

/// Weight of all texels, in pixels.
fn texels(run: &SavedRun) -> f64 {
    let textures = scene(run).photometric.as_ref().unwrap().textures.iter().flatten();
    let texels = textures.flat_map(|texture| texture.patches.as_flattened());
    texels.map(|texel| f64::from(texel.weight) / 256.0).sum()
}

#[test]
fn textures_of_shards_add_up() {
    let asked = SceneOverrides { textures: Some(50), ..asked(PhotometricMode::Light) };
    let (start, shards) = shards(&asked, 2);
    let fused = reread(&merge_onto(&start, shards.to_vec()).unwrap().unwrap());
    let added: f64 = shards.iter().map(|run| texels(run) - texels(&start)).sum();
    let (found, expected) = (texels(&fused), texels(&start) + added);
    assert!(added > 100.0 && (0.9..1.1).contains(&(found / expected)), "{found} of {expected}");
    let idle = SavedRun { path: "idle".into(), ..start.clone() };
    let one = merge_onto(&start, vec![shards[1].clone(), idle]).unwrap().unwrap();
    let textures = |run: &SavedRun| scene(run).photometric.clone().unwrap().textures;
    let pairs = textures(&one).into_iter().zip(textures(&shards[1]));
    let same = pairs.filter(|(a, b)| match (a, b) {
        (Some(a), Some(b)) => a.lattice == b.lattice && a.drawn().bytes() == b.drawn().bytes(),
        (a, b) => a.is_none() && b.is_none(),
    });
    let (same, n) = (same.count(), textures(&shards[1]).len());
    assert!(same * 10 > n * 9, "{same} of {n}");
}

/// Returns a run whose every texture is replaced by what `texture` returns for its number and splat.
fn retextured(run: &SavedRun, texture: impl Fn(usize, &Splat) -> Option<TextureSums>) -> SavedRun {
    let mut run = run.clone();
    let StoredModel::Scene(state) = &mut run.content.model else { unreachable!() };
    let photometric = state.photometric.as_mut().unwrap();
    let splats = photometric.splats.iter().enumerate();
    for ((id, splat), old) in splats.zip(&mut photometric.textures) {
        *old = old.as_ref().and_then(|_| Some(Arc::new(texture(id, splat)?)));
    }
    run
}

#[test]
fn textures_of_the_start_count_once_where_shards_laid_them_anew() {
    let asked = SceneOverrides { textures: Some(50), ..asked(PhotometricMode::Light) };
    let (start, shards) = shards(&asked, 3);
    // Pixels in the middle of a lattice of 16 × 16 texels, which lattices turned about it cover, too.
    let add = |texture: &mut TextureSums, n: u16| {
        for i in 0..n {
            let at = [5 + i % 6, 5 + i / 6 % 6].map(usize::from);
            let color = [200 + 9 * i as i16, 400, 100];
            let texel = texture.lattice.number_of(at);
            texture.open().add(&Observed { texel, weight: 256, color });
        }
    };
    let begun = |splat: &Splat| {
        let mut texture = TextureSums::new(splat, 0.1);
        texture.refine(2);
        add(&mut texture, 50);
        texture
    };
    let start = retextured(&start, |_, splat| Some(begun(splat)));
    // Two shards lay lattices anew, one of them twice, and one does not. All learn more.
    let continued = |k: usize, turns: &[f64]| {
        let of_start = scene(&start).photometric.as_ref().unwrap();
        retextured(&shards[k], |id, _| {
            let mut texture = of_start.textures.get(id)?.as_deref()?.clone();
            let splat = of_start.splats[id];
            for turn in turns {
                let [w, x, y, z] = splat.rotation.map(f64::from);
                let turned =
                    DQuat::from_xyzw(x, y, z, w) * DQuat::from_scaled_axis([*turn; 3].into());
                let rotation = [turned.w, turned.x, turned.y, turned.z].map(|v| v as f32);
                texture.lay_anew(&Splat { rotation, ..splat }, 0.1);
            }
            add(&mut texture, 20);
            Some(texture)
        })
    };
    let shards = [continued(0, &[0.3]), continued(1, &[]), continued(2, &[-0.2, 0.25])];
    let fused = reread(&merge_onto(&start, shards.to_vec()).unwrap().unwrap());
    let added: f64 = shards.iter().map(|run| texels(run) - texels(&start)).sum();
    assert!(added >= 60.0 * 20.0, "{added}");
    assert_eq!(texels(&fused), texels(&start) + added);
    let mut others = shards;
    others.rotate_left(1);
    let again = reread(&merge_onto(&start, others.to_vec()).unwrap().unwrap());
    assert!(again.content.model == fused.content.model);
}

#[test]
fn what_one_shard_alone_learnt_is_what_it_learnt() {
    let asked = asked(PhotometricMode::Light);
    let (start, shards) = shards(&asked, 2);
    // The other shard is the start itself: it adds no frame.
    let idle = SavedRun { path: "idle".into(), ..start.clone() };
    let one = merge_onto(&start, vec![shards[1].clone(), idle]).unwrap().unwrap();
    let (fused, alone) = (scene(&one), scene(&shards[1]));
    assert_eq!((&fused.seeds, &fused.visibility), (&alone.seeds, &alone.visibility));
    // Fusion makes moments positive definite, which changes them by a few quanta.
    assert!(fused.seeds.len() > 100 && farthest(&fused.sums, &alone.sums) <= 8);
    // Fusion first trains on the buffered photographs.
    let waiting = |run: &SavedRun| scene(run).photometric.as_ref().unwrap().buffered.len();
    assert_eq!((waiting(&one), waiting(&shards[1])), (0, 4));
    let (fused, alone) = (one.splats().unwrap(), shards[1].splats().unwrap());
    let far = fused
        .iter()
        .zip(alone.iter())
        .map(|(a, b)| (0..3).map(|k| (a.color[k] - b.color[k]).abs()).fold(0.0f32, f32::max));
    let mut far: Vec<f32> = far.collect();
    far.sort_by(f32::total_cmp);
    assert!(far[far.len() * 9 / 10] < 0.01, "{:?}", &far[far.len() * 9 / 10..]);
}

#[test]
fn a_fused_scene_keeps_to_the_budget() {
    let free = asked(PhotometricMode::Off);
    let (start, shards) = shards(&free, 2);
    let n = shards.iter().map(|run| scene(run).seeds.len()).max().unwrap();
    let union = merge_onto(&start, shards.clone()).unwrap().unwrap();
    assert!(scene(&union).seeds.len() > n, "the shards cover different places");
    let budget = Some(Budget::Components(n));
    let held = SceneOverrides { budget, ..free };
    let (start, shards) = self::shards(&held, 2);
    let all = reread(&merge_onto(&start, shards.clone()).unwrap().unwrap());
    let used = all.revive().unwrap().learner.status().used;
    assert!(used <= n, "{used} of {n}");
    assert_eq!(points(scene(&all)), points(scene(&union)));
}

#[test]
fn a_fused_scene_without_pairs_to_merge_grows_its_scale() {
    let config = SceneConfig { max_components: 4, ..SceneConfig::fine(0.2) };
    // Three patches of a wall, each within one component.
    let is_measured = |i: usize| (i % 64) % 24 < 4 && (i / 64) < 4;
    let scene_at = |x: f64| {
        let (n, k) = (64 * 48, Intrinsics::from_horizontal_fov(64, 48, 1.0));
        let length = |i| if is_measured(i) { 2.0 } else { 0.0 };
        let (lengths, colors): (Vec<f32>, _) = ((0..n).map(length).collect(), vec![128; 3 * n]);
        let trusted = [0.0, f64::INFINITY];
        let depth = DepthBuffer { lengths: &lengths, kind: DepthKind::Z, trusted };
        let pose = DMat4::from_translation(DVec3::X * x);
        let colors = ColorBuffer::Rgb8(&colors);
        let frame = Frame::from_memory("0", k, pose, colors, Some(depth)).unwrap();
        let surface = SurfaceSettings::of_sensor(Sensor::Exact { noise: 0.0 }, DVec3::ZERO);
        let mut seen = Observation::empty();
        Preparer::new().prepare(&frame, &surface, &mut seen).unwrap();
        let mut trainer = SceneTrainer::new(&config, DVec3::ZERO);
        trainer.learn(&seen).unwrap();
        let StoredModel::Scene(state) = trainer.checkpoint_model() else { unreachable!() };
        state
    };
    let scenes = [0.0, 5.0].map(scene_at);
    assert_eq!(scenes.each_ref().map(|scene| scene.visibility.len()), [3; 2]);
    let fused = fuse(&config, None, &scenes.each_ref()).unwrap();
    let steps = [&scenes[0], &scenes[1], &fused].map(|scene| scene.coarsening_steps);
    assert!(steps[2] > steps[0].max(steps[1]), "{steps:?}");
    let used = SceneTrainer::restore(&config, fused, 2).unwrap().status().used;
    assert!(used <= config.max_components, "{used}");
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
    let one = saved(&trained(&off(), shard("1/8")));
    let error = merge_onto(&one, vec![one.clone()]).unwrap_err();
    assert!(matches!(error, RunError::Origin { .. }), "{error}");
    let twice = merge(shards.clone()).unwrap_err().to_string();
    assert!(twice.contains("--start"), "{twice}");
}
