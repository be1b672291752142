//! Scenes that stop, resume and are merged.

use super::*;
use vbgs_studio::dataset::calibration::Calibration;
use vbgs_studio::dataset::surface::Sensor;
use vbgs_studio::export::checkpoint::StoredModel;
use vbgs_studio::model::scene::state::SceneState;
use vbgs_studio::pipeline::checkpoint::merge;
use vbgs_studio::pipeline::settings::GivenSettings;
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::train::scene::photometric::rule::PhotometricMode;
use vbgs_studio::train::scene::units::{Budget, StructuralScale};
use vbgs_studio::train::setting::Preset;

fn plain() -> SceneOverrides {
    SceneOverrides::default()
}

/// Scale coarse enough that the sums of some components overflow a narrow row.
fn coarse() -> SceneOverrides {
    SceneOverrides { scale: Some(StructuralScale::World(3.0)), ..plain() }
}

fn scene(content: &Checkpoint) -> &SceneState {
    let StoredModel::Scene(state) = &content.model else { unreachable!() };
    state
}

#[test]
fn a_scene_that_stopped_is_the_scene_that_did_not() {
    let whole = with_threads(1, || trained(&plain(), first(FRAMES)));
    let (expected, file) = (timeless(whole.checkpoint().unwrap()), ply(&whole));
    for threads in [1, 2] {
        let half = with_threads(3 - threads, || saved(&trained(&plain(), first(FRAMES / 2))));
        let resumed =
            with_threads(threads, || finished(half.resume(room(), &up_to(FRAMES), false).unwrap()));
        assert!(timeless(resumed.checkpoint().unwrap()) == expected, "{threads} threads");
        assert!(ply(&resumed) == file, "{threads} threads");
    }
}

fn photographed() -> SceneOverrides {
    let photometric = Some(PhotometricMode::Full);
    SceneOverrides { photometric, shuffle_buffer: Some(3), ..SceneOverrides::default() }
}

#[test]
fn what_photographs_taught_is_stored_and_goes_on() {
    let whole = with_threads(1, || trained(&photographed(), first(12)));
    let expected = timeless(whole.checkpoint().unwrap());
    let half = with_threads(2, || saved(&trained(&photographed(), first(5))));
    let resumed = with_threads(2, || finished(half.resume(room(), &up_to(12), false).unwrap()));
    assert!(timeless(resumed.checkpoint().unwrap()) == expected);
    assert_eq!(resumed.splats(), whole.splats());
    let state = scene(&expected).photometric.as_ref().unwrap();
    assert!(state.splats.iter().any(|splat| splat.is_drawable()));
    assert_eq!(state.buffered.len(), 3);
    let other = SceneOverrides { photometric: Some(PhotometricMode::Off), ..Default::default() };
    let refused = saved(&whole).check(&ResumeRequest { model: other.into(), ..up_to(12) });
    assert!(
        refused
            .unwrap_err()
            .to_string()
            .starts_with("photometric (`--photometric`): expected full")
    );
}

/// Budgets so small that components merge, and that all texels become coarser.
fn textured() -> SceneOverrides {
    let budget = Some(Budget::Components(150));
    SceneOverrides { budget, textures: Some(1), ..photographed() }
}

#[test]
fn textures_are_stored_and_go_on() {
    let ample = SceneOverrides { textures: Some(50), ..photographed() };
    for asked in [ample, textured()] {
        let whole = with_threads(1, || trained(&asked, first(12)));
        let expected = timeless(whole.checkpoint().unwrap());
        let half = with_threads(2, || saved(&trained(&asked, first(5))));
        let resumed = with_threads(2, || finished(half.resume(room(), &up_to(12), false).unwrap()));
        assert!(timeless(resumed.checkpoint().unwrap()) == expected);
        let (state, splats) = (scene(&expected).photometric.as_ref().unwrap(), whole.splats());
        let textured = || state.textures.iter().flatten();
        let patches = textured().map(|texture| texture.patches.len()).sum::<usize>();
        assert!(textured().count() > 20 && patches > 20, "{} {patches}", textured().count());
        // Drawn from the file, before any photograph: each texture with the component that learned it.
        let drawn = splats.finishing().textures.as_deref().unwrap();
        let again = reread(&saved(&whole)).splats().unwrap();
        assert!(again.finishing().textures.as_deref() == Some(drawn));
        assert!(resumed.splats().finishing().textures.as_deref() == Some(drawn));
        for (id, texture) in state.textures.iter().enumerate() {
            // Buffered photographs change how far a drawn texture is trusted, not where it lies.
            let lattice = texture.as_ref().map(|texture| texture.lattice);
            assert!(drawn[id].as_ref().map(|drawn| drawn.lattice) == lattice, "{id}");
        }
    }
}

/// Textures of merged components belong to those that their seeds now belong to.
#[test]
fn textures_follow_merged_components() {
    let asked = SceneOverrides { textures: Some(50), ..textured() };
    let session = trained(&asked, first(12));
    let checkpoint = session.checkpoint().unwrap();
    let state = scene(&checkpoint);
    let of_seeds = state.components.as_ref().expect("components that were merged");
    let textures = &state.photometric.as_ref().unwrap().textures;
    let is_used = |id: usize| of_seeds.contains(&(id as u32));
    let textured: Vec<usize> = (0..textures.len()).filter(|&id| textures[id].is_some()).collect();
    assert!(textured.iter().all(|&id| is_used(id)), "a texture of an unused component");
    assert!(textured.len() > 20, "{}", textured.len());
}

#[test]
fn a_scene_may_stop_after_every_frame() {
    for asked in [coarse(), plain(), photographed(), textured()] {
        let expected = timeless(trained(&asked, first(12)).checkpoint().unwrap());
        let mut run = saved(&trained(&asked, first(1)));
        for n_frames in 2..=12 {
            run = saved(&finished(run.resume(room(), &up_to(n_frames), false).unwrap()));
        }
        assert!(timeless(run.content) == expected, "{asked:?}");
    }
}

#[test]
fn the_scene_is_as_it_was_at_once() {
    let session = trained(&plain(), first(5));
    let run = saved(&session);
    assert_eq!(run.config, *session.config());
    assert!(run.splats().unwrap() == session.splats());
    assert_eq!(run.up(), session.up());
    let learner = run.revive().unwrap().learner;
    assert_eq!(learner.status().components, session.learner().status().components);
    let resumed = run.resume(room(), &ResumeRequest::default(), false).unwrap();
    assert_eq!(resumed.normalization(), session.normalization());
    assert_eq!(timeless(resumed.checkpoint().unwrap()), timeless(session.checkpoint().unwrap()));
}

#[test]
fn a_session_without_frames_is_stored_too() {
    let session = Session::new(room(), plain(), first(1)).unwrap();
    let run = saved(&session);
    assert!(scene(&run.content).seeds.is_empty() && run.splats().unwrap().is_empty());
    let expected = timeless(finished(session).checkpoint().unwrap());
    let resumed = finished(run.resume(room(), &ResumeRequest::default(), false).unwrap());
    assert!(timeless(resumed.checkpoint().unwrap()) == expected);
}

#[test]
fn scenes_that_began_apart_are_refused() {
    let base = saved(&trained(&plain(), shard("1/2")));
    let refused = |other: SavedRun, parts: &[&str]| {
        let said = merge(vec![base.clone(), other]).unwrap_err().to_string();
        for part in parts {
            assert!(said.contains(part), "{part:?} is missing in: {said}");
        }
    };
    let other = |asked: &SceneOverrides| saved(&trained(asked, shard("2/2")));
    let wider = StructuralScale::Pixels(5.0);
    let scale = other(&SceneOverrides { scale: Some(wider), ..plain() });
    refused(scale, &["the same structural scale", "same settings"]);
    let flat = other(&SceneOverrides { gradient: Some(false), ..plain() });
    refused(flat, &["the same setting `native`", "\"gradient\":false"]);
    refused(saved(&trained(&off(), shard("2/2"))), &["setting `preset`", "scene and paper"]);
    let mut moved = base.clone();
    let Method::Scene(run) = &mut moved.config.method else { unreachable!() };
    run.surface.origin.x += 1.0;
    refused(moved, &["the same origin"]);
    refused(base.clone(), &["expected no frame in both, found 20, the first 0"]);
    let stride = Selection { stride: 2, ..shard("2/2") };
    refused(saved(&trained(&plain(), stride)), &["expected the same"]);
}

#[test]
fn settings_that_contradict_the_scene_are_refused_by_name() {
    let run = saved(&trained(&plain(), first(2)));
    let with =
        |scene: SceneOverrides| ResumeRequest { model: scene.into(), ..ResumeRequest::default() };
    let none = SceneOverrides::default;
    let cases = [
        (
            "scale (`--scale`)",
            with(SceneOverrides { scale: Some(StructuralScale::Pixels(3.0)), ..none() }),
        ),
        (
            "budget (`--budget`)",
            with(SceneOverrides { budget: Some(Budget::Components(9)), ..none() }),
        ),
        ("refine", with(SceneOverrides { refine: Some(false), ..none() })),
        ("gain", with(SceneOverrides { gain: Some(true), ..none() })),
        ("gradient", with(SceneOverrides { gradient: Some(false), ..none() })),
        ("directional", with(SceneOverrides { directional: Some(false), ..none() })),
        ("plane_fit", with(SceneOverrides { plane_fit: Some(false), ..none() })),
        ("flying_pixels", with(SceneOverrides { flying_pixels: Some(true), ..none() })),
        ("cosine", with(SceneOverrides { cosine: Some(false), ..none() })),
        ("sensor", with(SceneOverrides { sensor: Some(Sensor::Kinect), ..none() })),
        (
            "calibration (`--calibration`)",
            with(SceneOverrides { calibration: Some(Calibration::NONE), ..none() }),
        ),
        ("seed", with(SceneOverrides { seed: Some(5), ..none() })),
        (
            "preset (`--preset`)",
            ResumeRequest { preset: Some(Preset::Paper), ..ResumeRequest::default() },
        ),
        (
            "components",
            ResumeRequest {
                model: PaperOverrides { components: Some(5), ..PaperOverrides::default() }.into(),
                ..ResumeRequest::default()
            },
        ),
        ("stride", ResumeRequest { stride: Some(2), ..ResumeRequest::default() }),
    ];
    for (setting, asked) in cases {
        let said = run.check(&asked).expect_err(setting).to_string();
        let start = format!("{setting}: expected ");
        assert!(said.starts_with(&start) && said.contains("as "), "{setting}: {said}");
        assert!(run.clone().resume(room(), &asked, true).is_err());
    }
    let repeated = ResumeRequest {
        preset: Some(Preset::Scene),
        model: GivenSettings {
            paper: PaperOverrides { seed: Some(0), ..PaperOverrides::default() },
            scene: SceneOverrides {
                seed: Some(0),
                scale: Some(StructuralScale::Pixels(2.0)),
                refine: Some(true),
                gradient: Some(true),
                plane_fit: Some(true),
                sensor: Some(Sensor::Exact { noise: 0.0 }),
                ..SceneOverrides::default()
            },
        },
        max_frames: Some(4),
        ..ResumeRequest::default()
    };
    assert_eq!(finished(run.resume(room(), &repeated, false).unwrap()).frames().len(), 4);
    let mixture = saved(&trained(&off(), first(2)));
    let refine = with(SceneOverrides { refine: Some(false), ..none() });
    let said = mixture.check(&refine).unwrap_err().to_string();
    assert!(said.starts_with("refine: expected no value"), "{said}");
}

#[test]
fn settings_and_scenes_that_do_not_belong_together_are_refused() {
    let run = saved(&trained(&plain(), first(2)));
    let refused = |edit: &dyn Fn(&mut Checkpoint), part: &str| {
        let mut content = run.content.clone();
        edit(&mut content);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.vbgs");
        write(&path, &content).unwrap();
        let said = SavedRun::read(&path).expect_err(part).to_string();
        assert!(said.contains("x.vbgs") && said.contains(part), "{part:?}: {said}");
    };
    let config = |from: &'static str, to: &'static str| {
        move |content: &mut Checkpoint| {
            let edited = content.config.replace(from, to);
            assert_ne!(edited, content.config, "{from}");
            content.config = edited;
        }
    };
    refused(&config(r#""h":0."#, r#""h":-0."#), "scale (`--scale`): expected a length above 0");
    refused(&config(r#""refine":true"#, r#""refine":"rows""#), "section `CONF`");
    let moved = |content: &mut Checkpoint| {
        let StoredModel::Scene(state) = &mut content.model else { unreachable!() };
        state.origin[2] += 1.0;
    };
    refused(&moved, "expected the origin");
    let mixture = saved(&trained(&off(), first(1)));
    refused(&|content| content.config.clone_from(&mixture.content.config), "expected a mixture");
    refused(&|content| content.model = mixture.content.model.clone(), "expected a scene");
}

/// A scene whose budget merged components reads back from its file.
#[test]
fn merged_scenes_are_read_back() {
    for budget in [20, 80, 150] {
        let budget = Some(Budget::Components(budget));
        let session = trained(&SceneOverrides { budget, ..plain() }, first(6));
        let run = saved(&session);
        // The smallest budgets may coarsen the scale instead, so that nothing is merged.
        let scene = scene(&run.content);
        let is_reached = scene.components.is_some() || scene.coarsening_steps > 0;
        assert!(is_reached, "{budget:?}: the budget was not reached");
        assert_eq!(run.splats().unwrap(), session.splats(), "{budget:?}");
    }
}
