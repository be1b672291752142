//! Resuming after a stop.

use super::*;
use vbgs_studio::train::paper::config::Init;

const POLICIES: [ReassignPolicy; 3] =
    [ReassignPolicy::Off, ReassignPolicy::Padded, ReassignPolicy::Forwarded];

#[test]
fn a_run_that_stopped_is_the_run_that_did_not() {
    for reassign in POLICIES {
        for precision in [Precision::Mixed, Precision::F64] {
            let config = config(reassign, precision);
            let whole = with_threads(1, || trained(&config, first(FRAMES)));
            let (expected, scene) = (timeless(whole.checkpoint().unwrap()), ply(&whole));
            for threads in [1, 2] {
                let name = format!("{reassign:?} {precision:?} {threads} threads");
                let half =
                    with_threads(3 - threads, || saved(&trained(&config, first(FRAMES / 2))));
                let resumed = with_threads(threads, || {
                    finished(half.resume(room(), &up_to(FRAMES), false).unwrap())
                });
                assert!(timeless(resumed.checkpoint().unwrap()) == expected, "{name}");
                assert!(ply(&resumed) == scene, "{name}");
            }
        }
    }
}

#[test]
fn a_run_may_stop_after_every_frame() {
    let config = config(ReassignPolicy::Padded, Precision::Mixed);
    let expected = timeless(trained(&config, first(6)).checkpoint().unwrap());
    let mut run = saved(&trained(&config, first(1)));
    for n_frames in 2..=6 {
        run = saved(&finished(run.resume(room(), &up_to(n_frames), false).unwrap()));
    }
    assert!(timeless(run.content) == expected);
}

#[test]
fn the_model_is_as_it_was_at_once() {
    let session = trained(&config(ReassignPolicy::Forwarded, Precision::Mixed), first(5));
    let run = saved(&session);
    assert_eq!(run.splats().unwrap(), session.splats());
    assert_eq!(run.up(), session.up());
    let learner = run.revive().unwrap().learner;
    for k in 0..learner.status().components {
        assert_eq!(learner.component(k).posterior, session.learner().component(k).posterior);
    }
    let resumed = run.resume(room(), &ResumeRequest::default(), false).unwrap();
    assert_eq!(resumed.splats(), session.splats());
    assert_eq!(timeless(resumed.checkpoint().unwrap()), timeless(session.checkpoint().unwrap()));
}

#[test]
fn the_report_covers_the_whole_run() {
    let config = config(ReassignPolicy::Forwarded, Precision::Mixed);
    let run = saved(&trained(&config, first(7)));
    let (before, wall_s) = (run.content.clone(), run.meta.wall_s);
    let resumed = finished(run.resume(room(), &up_to(12), false).unwrap());
    let report = resumed.report(None, Vec::new());
    let indices: Vec<usize> = report.frames.iter().map(|f| f.index).collect();
    assert_eq!(indices, (0..12).collect::<Vec<_>>());
    let whole = trained(&config, first(12)).report(None, Vec::new());
    for (a, b) in report.frames.iter().zip(&whole.frames) {
        let named = |f: &vbgs_studio::eval::report::FrameReport| {
            (f.frame.clone(), f.points, f.used, f.reassigned, f.elbo_mean.to_bits())
        };
        assert_eq!(named(a), named(b));
    }
    assert!(report.summary.wall_s > wall_s);
    let after = resumed.checkpoint().unwrap();
    let points = |n: usize| whole.frames[..n].iter().map(|f| f.points as u64).sum::<u64>();
    assert_eq!((before.cursor.points, after.cursor.points), (points(7), points(12)));
}

#[test]
fn order_stride_and_settings_come_from_the_checkpoint() {
    let overrides = PaperOverrides {
        seed: Some(3),
        init: Some(Init::Data),
        scale_factor: Some(1.41),
        ..PaperOverrides::default()
    };
    let config = config(ReassignPolicy::Padded, Precision::Mixed).with(&overrides).unwrap();
    let selection = |max_frames| Selection {
        order: vbgs_studio::pipeline::plan::Order::Shuffled,
        stride: 2,
        max_frames,
        ..Selection::all_frames()
    };
    let whole = trained(&config, selection(None));
    assert_eq!(whole.frames().len(), FRAMES / 2);
    let run = saved(&trained(&config, selection(Some(9))));
    assert_eq!(*paper(&run), config);
    let resumed = finished(run.resume(room(), &up_to(1000), false).unwrap());
    assert_eq!(resumed.plan().frames, whole.plan().frames);
    assert!(ply(&resumed) == ply(&whole));
    // Resuming a finished run changes nothing.
    let again = finished(saved(&resumed).resume(room(), &up_to(5), false).unwrap());
    assert!(ply(&again) == ply(&whole));
}

#[test]
fn settings_are_stored_bit_for_bit() {
    let mut awkward = off();
    for (i, fraction) in
        [0.1 + 0.2, 1.0 / 3.0, 5e-324, 0.049999999999999996].into_iter().enumerate()
    {
        let overrides = PaperOverrides {
            seed: Some(u64::MAX - i as u64),
            reassign_fraction: Some(fraction),
            scale_factor: Some(1.0 + fraction),
            ..PaperOverrides::default()
        };
        awkward = awkward.with(&overrides).unwrap();
        let run = saved(&Session::new(room(), awkward.clone(), first(1)).unwrap());
        assert_eq!(*paper(&run), awkward);
        assert_eq!(paper(&run).reassign_fraction.to_bits(), fraction.to_bits());
    }
}
