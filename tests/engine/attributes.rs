//! Attributes of components in a session: evidence, uncertainty, ELBO of the current frame and birth.

use super::checkpoint::room_of;
use glam::DVec3;
use vbgs_studio::pipeline::checkpoint::{ResumeRequest, SavedRun};
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::{Session, Step};
use vbgs_studio::train::learner::Changed;
use vbgs_studio::train::paper::config::{
    Candidates, PaperConfig, PaperOverrides, Precision, ReassignPolicy,
};
use vbgs_studio::train::setting::table::SettingLayer;

const COMPONENTS: usize = 3000;

fn session(overrides: PaperOverrides) -> Session {
    let base = PaperOverrides { components: Some(COMPONENTS), ..PaperOverrides::default() };
    let config = PaperConfig::paper().with(&overrides.or(base)).unwrap();
    Session::new(room_of(6, 4), config, Selection::all_frames()).unwrap()
}

fn all() -> Vec<u32> {
    (0..COMPONENTS as u32).collect()
}

/// The fused kernels and the plain engine find each point's component by different code.
#[test]
fn the_elbo_of_components_adds_up_to_that_of_the_frame() {
    let ways = [
        PaperOverrides::default(),
        PaperOverrides { precision: Some(Precision::F64), ..PaperOverrides::default() },
        PaperOverrides { candidates: Some(Candidates::Nearest(1)), ..PaperOverrides::default() },
    ];
    for way in ways {
        for reassign in [ReassignPolicy::Off, ReassignPolicy::Padded, ReassignPolicy::Forwarded] {
            let name = format!("{way:?} {reassign:?}");
            let mut session = session(PaperOverrides { reassign: Some(reassign), ..way.clone() });
            session.start_component_elbo();
            while let Step::Trained(frame) = session.step().unwrap() {
                let engine = session.learner();
                let elbo = engine.last_frame().component_elbo;
                let known = elbo.components();
                let of = |&id: &u32| elbo.mean_elbo_of(id as usize).unwrap();
                let (sum, n) = known
                    .iter()
                    .map(of)
                    .fold((0.0, 0), |(sum, n), (mean, own)| (sum + mean * f64::from(own), n + own));
                assert_eq!(n as usize, frame.points, "{name}");
                let expected = frame.elbo_mean * frame.points as f64;
                assert!((sum / expected - 1.0).abs() < 1e-9, "{name}: {sum} {expected}");
                let Changed::Listed(touched) = engine.last_frame().changed else {
                    panic!("{name}: all")
                };
                assert!(known.iter().all(|id| touched.contains(id)), "{name}");
            }
        }
    }
}

#[test]
fn a_component_has_an_elbo_only_while_somebody_asks_and_only_of_the_current_frame() {
    let mut session = session(PaperOverrides::default());
    let known = |session: &Session| {
        let attributes = session.attributes_of(&all());
        let with = attributes.iter().zip(0u32..).filter(|(a, _)| a.elbo.is_some());
        with.map(|(_, id)| id).collect::<Vec<_>>()
    };
    session.step().unwrap();
    assert!(known(&session).is_empty());
    session.start_component_elbo();
    session.step().unwrap();
    let second = known(&session);
    session.step().unwrap();
    let third = known(&session);
    assert!(!second.is_empty() && second != third);
    let mut ids = session.learner().last_frame().component_elbo.components().to_vec();
    ids.sort_unstable();
    assert_eq!(third, ids);
    session.stop_component_elbo();
    assert!(known(&session).is_empty());
}

#[test]
fn asking_changes_nothing_of_the_model() {
    let finish = |mut session: Session| {
        while !matches!(session.step().unwrap(), Step::Finished) {}
        session.checkpoint().unwrap().model
    };
    let plain = finish(session(PaperOverrides::default()));
    let mut asked = session(PaperOverrides::default());
    asked.start_component_elbo();
    assert!(finish(asked) == plain);
}

#[test]
fn components_are_born_with_their_first_points() {
    let mut session = session(PaperOverrides::default());
    let mut born: Vec<Option<u32>> = vec![None; COMPONENTS];
    while let Step::Trained(frame) = session.step().unwrap() {
        for (id, (attributes, born)) in
            session.attributes_of(&all()).iter().zip(&mut born).enumerate()
        {
            let is_used = session.learner().component(id).posterior.count > 0.0;
            if is_used && born.is_none() {
                *born = Some(frame.index as u32);
            }
            assert_eq!(attributes.birth, *born, "{id}");
            assert_eq!(attributes.evidence.is_some(), is_used);
        }
    }
    let first = born.iter().flatten().filter(|&&frame| frame == 0).count();
    assert!(first > 0 && first < born.iter().flatten().count(), "{first}");
}

#[test]
fn births_before_a_stop_are_not_known() {
    let folder = tempfile::tempdir().unwrap();
    let mut session = session(PaperOverrides::default());
    session.step().unwrap();
    let file = folder.path().join("run.vbgs");
    session.save(&file).unwrap();
    let first = session.learner().status().used;
    let run = SavedRun::read(&file).unwrap();
    let mut resumed = run.resume(room_of(6, 4), &ResumeRequest::default(), false).unwrap();
    while !matches!(resumed.step().unwrap(), Step::Finished) {}
    let attributes = resumed.attributes_of(&all());
    let unknown = attributes.iter().filter(|a| a.evidence.is_some() && a.birth.is_none());
    assert_eq!(unknown.count(), first);
    assert!(attributes.iter().filter_map(|a| a.birth).all(|birth| birth > 0));
}

#[test]
fn an_inspection_agrees_with_what_is_drawn() {
    let mut session = session(PaperOverrides::default());
    while !matches!(session.step().unwrap(), Step::Finished) {}
    let inspected: Vec<_> = all().iter().map(|&id| session.inspect(id).unwrap()).collect();
    let weight: f64 = inspected.iter().map(|i| i.weight).sum();
    assert!((weight - 1.0).abs() < 1e-6, "{weight}");
    let splats = session.splats();
    for i in inspected.iter().filter(|i| i.posterior.count > 0.0) {
        assert_eq!(i.splat, splats[i.id as usize]);
        let drawn = DVec3::from_array(i.splat.mean.map(f64::from));
        assert!(i.mean.distance(drawn) < 1e-5);
        let [a, b] = [i.covariance.to_array(), i.splat.covariance().to_array()];
        let largest = i.covariance.trace();
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5 * largest), "{a:?} {b:?}");
        let deviation = (largest / i.posterior.kappa_space).sqrt();
        let uncertainty = f64::from(i.attributes.uncertainty.unwrap());
        assert!((uncertainty / deviation - 1.0).abs() < 1e-6);
    }
    assert_eq!(session.inspect(COMPONENTS as u32), None);
}
