//! Checkpoints that cannot be resumed, and settings that conflict with them.

use super::*;
use vbgs_studio::dataset::LoadOptions;
use vbgs_studio::export::checkpoint::{CheckpointError, StoredModel};
use vbgs_studio::model::conjugate::prior::Hyper;
use vbgs_studio::model::paper::state::ModelState;
use vbgs_studio::model::splat::splats::CovarianceForm;
use vbgs_studio::pipeline::checkpoint::RunError;
use vbgs_studio::pipeline::plan::Order;
use vbgs_studio::train::paper::config::{Candidates, Init};
use vbgs_studio::train::setting::Preset;

fn half() -> SavedRun {
    saved(&trained(&off(), first(3)))
}

#[test]
fn settings_that_contradict_the_run_are_refused_by_name() {
    let run = half();
    let train =
        |paper: PaperOverrides| ResumeRequest { model: paper.into(), ..ResumeRequest::default() };
    let none = PaperOverrides::default;
    let cases = [
        ("components", train(PaperOverrides { components: Some(5), ..none() })),
        ("seed", train(PaperOverrides { seed: Some(5), ..none() })),
        ("candidates", train(PaperOverrides { candidates: Some(Candidates::Dense), ..none() })),
        ("init", train(PaperOverrides { init: Some(Init::Data), ..none() })),
        ("reassign", train(PaperOverrides { reassign: Some(ReassignPolicy::Dense), ..none() })),
        ("reassign_fraction", train(PaperOverrides { reassign_fraction: Some(0.5), ..none() })),
        ("precision", train(PaperOverrides { precision: Some(Precision::F64), ..none() })),
        ("scale_factor", train(PaperOverrides { scale_factor: Some(1.5), ..none() })),
        (
            "covariance_form",
            train(PaperOverrides {
                covariance_form: Some(CovarianceForm::LegacyCholesky),
                ..none()
            }),
        ),
        (
            "split (`--split`)",
            ResumeRequest { split: Some("eval".into()), ..ResumeRequest::default() },
        ),
        ("order", ResumeRequest { order: Some(Order::Shuffled), ..ResumeRequest::default() }),
        ("stride", ResumeRequest { stride: Some(2), ..ResumeRequest::default() }),
        (
            "depth range (`--depth-range`)",
            ResumeRequest {
                load: LoadOptions {
                    depth_range: Some([0.1, 2.0]),
                    depth_scale: None,
                    ..LoadOptions::default()
                },
                ..ResumeRequest::default()
            },
        ),
    ];
    for (setting, asked) in cases {
        let said = run.check(&asked).expect_err(setting).to_string();
        let start = format!("{setting}: expected ");
        assert!(said.starts_with(&start) && said.contains("as "), "{setting}: {said}");
        assert!(run.clone().resume(room(), &asked, true).is_err());
    }
}

#[test]
fn settings_that_repeat_the_run_are_fine() {
    let run = half();
    let asked = ResumeRequest {
        preset: Some(Preset::Paper),
        model: PaperOverrides {
            components: Some(3000),
            candidates: Some(Candidates::Nearest(4)),
            reassign: Some(ReassignPolicy::Off),
            precision: Some(Precision::Mixed),
            covariance_form: Some(CovarianceForm::Eigen),
            scale_factor: Some(1.0),
            ..PaperOverrides::default()
        }
        .into(),
        order: Some(Order::Sequential),
        stride: Some(1),
        max_frames: Some(4),
        ..ResumeRequest::default()
    };
    assert_eq!(finished(run.resume(room(), &asked, false).unwrap()).frames().len(), 4);
}

#[test]
fn another_dataset_needs_force() {
    let refused = |dataset: Arc<Dataset>, part: &str| {
        let error = half().resume(dataset.clone(), &up_to(5), false).err().unwrap();
        assert!(matches!(error, RunError::OtherDataset { .. }));
        let said = error.to_string();
        assert!(said.contains(part) && said.contains("name the right dataset"), "{said}");
        half().resume(dataset, &up_to(5), true)
    };
    let longer = refused(room_of(FRAMES + 2, 4), "number of frames (expected 40, found 42)");
    assert_eq!(finished(longer.unwrap()).frames().len(), 5);
    let mut turned = (*room()).clone();
    turned.splits[0].frames.swap(5, 6);
    assert!(refused(Arc::new(turned), "poses").is_ok());
    let mut shorter = (*room()).clone();
    shorter.splits[0].frames.truncate(2);
    let error = refused(Arc::new(shorter), "number of frames").err().unwrap();
    assert!(error.to_string().contains("expected 3 frames or more"), "{error}");
}

#[test]
fn sections_that_do_not_belong_together_are_refused() {
    let run = half();
    let refused = |edit: &dyn Fn(&mut Checkpoint), part: &str| {
        let mut content = run.content.clone();
        edit(&mut content);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.vbgs");
        write(&path, &content).unwrap();
        let result = SavedRun::read(&path).and_then(|run| run.resume(room(), &up_to(4), false));
        let said = result.err().expect(part).to_string();
        assert!(said.contains("x.vbgs") && said.contains(part), "{part:?}: {said}");
    };
    refused(&|c| c.config = "{".into(), "section `CONF`");
    refused(&|c| c.config = c.config.replace("3000", "0"), "expected 1 to 20000000, found 0");
    refused(&|c| c.config = c.config.replace("3000", "2999"), "expected the prior");
    refused(&|c| *mixture(c).0 = Hyper::paper(3000, 1.0), "expected the prior");
    let narrow = |c: &mut Checkpoint| {
        let precision = |of| format!(r#""precision":"{of}""#);
        let wide = c.config.replace("fixed64", "fixed128");
        c.config = wide.replace(&precision("mixed"), &precision("custom"));
    };
    refused(&narrow, "expected totals of the form Fixed128");
    refused(&|c| c.meta = "[]".into(), "section `META`");
    refused(&|c| c.history = Some("{}".into()), "section `HIST`");
    let missing = SavedRun::read(Path::new("none.vbgs")).unwrap_err();
    assert!(matches!(missing, RunError::File(CheckpointError::File(_))), "{missing}");
}

fn mixture(content: &mut Checkpoint) -> (&mut Hyper, &mut ModelState) {
    let StoredModel::Mixture { hyper, state, .. } = &mut content.model else { unreachable!() };
    (hyper, state)
}

#[test]
fn another_machine_is_a_warning() {
    let mut run = half();
    assert_eq!(run.numerics_differ(), None);
    run.content.numerics = r#"{"arch":"abacus"}"#.into();
    let said = run.numerics_differ().unwrap();
    assert!(said.contains("abacus") && said.contains("last bits"), "{said}");
    assert!(run.resume(room(), &ResumeRequest::default(), false).is_ok());
}

#[test]
fn settings_that_an_older_file_lacks_are_the_papers() {
    let mut run = half();
    let mut config: serde_json::Value = serde_json::from_str(&run.content.config).unwrap();
    config.as_object_mut().unwrap().remove("low_elbo_floor").unwrap();
    run.content.config = config.to_string();
    assert_eq!(reread(&run).config, run.config);
}

/// The fixture was written by version 1.0 and is never regenerated: every later version must open it.
#[test]
fn the_run_of_version_1_0_still_opens() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/run_1_0.vbgs");
    let run = SavedRun::read(&path).unwrap();
    assert_eq!(run.version, (1, 0));
    let config = &run.config;
    let train = paper(&run);
    assert_eq!((train.components, train.seed), (12, 7));
    assert_eq!(train.reassign, ReassignPolicy::Forwarded);
    assert_eq!((config.selection.stride, config.selection.max_frames), (2, Some(3)));
    assert_eq!(run.content.cursor.visited, [0, 2, 4]);
    assert_eq!(run.revive().unwrap().learner.status().used, 12);
    assert_eq!(run.splats().unwrap().iter().filter(|s| s.is_drawable()).count(), 12);
}
