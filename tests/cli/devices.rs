//! Devices for training and for comparing photographs, chosen on the command line.

use super::runner::Scratch;
use serde_json::Value;

/// `comparer` section of the report, and stdout.
fn trained(arguments: &str) -> (Value, String) {
    let (report, said) = report(&Scratch::with_room(), "out", arguments);
    (report["comparer"].clone(), said)
}

fn report(scratch: &Scratch, out: &str, arguments: &str) -> (Value, String) {
    let command = format!("train room --out {out} --max-frames 3 {arguments}");
    let run = scratch.run(&command).succeeds();
    (scratch.json(&format!("{out}/report.json")), run.stdout)
}

#[test]
fn the_processor_compares_where_it_is_asked_to() {
    let (used, said) = trained("--device cpu");
    assert_eq!(used["device"], Value::Null);
    assert_eq!((&used["processor_frames"], &used["device_frames"]), (&3.into(), &0.into()));
    assert!(said.contains("the CPU compared photographs"), "{said}");
    let (none, said) = trained("--photometric off");
    assert!(none.is_null() && !said.contains("photographs"), "{none} {said}");
}

/// Asked for, a software adapter is as good as any.
#[cfg(feature = "gui")]
#[test]
fn a_gpu_compares_where_it_is_asked_to() {
    let Some(adapter) = crate::common::adapter::vulkan() else { return };
    let (used, said) = trained("--photometric full --device gpu");
    assert_eq!((&used["processor_frames"], &used["device_frames"]), (&0.into(), &3.into()));
    let name = used["device"].as_str().unwrap();
    assert!(said.contains(&format!("{name} compared photographs")), "{said}");
    if adapter.get_info().device_type == wgpu::DeviceType::Cpu {
        let (auto, _) = trained("--photometric full");
        assert_eq!(auto["device"], Value::Null, "auto never selects a software adapter");
    }
}

const PAPER: &str = "--preset paper --set components=2000";

#[test]
fn the_processor_trains_where_it_is_asked_to() {
    let scratch = Scratch::with_room();
    let (report_of_cpu, said) = report(&scratch, "out", &format!("{PAPER} --device cpu"));
    let used = &report_of_cpu["passes"];
    assert_eq!((&used["device"], &used["processor_frames"]), (&Value::Null, &3.into()));
    assert!(!said.contains("fitted"), "{said}");
    let (of_scene, said) = report(&scratch, "scene", "--device cpu");
    assert!(of_scene["passes"].is_null());
    let used = &of_scene["points"];
    assert_eq!((&used["device"], &used["processor_frames"]), (&Value::Null, &3.into()));
    assert!(!said.contains("fitted"), "{said}");
}

#[test]
fn a_gpu_that_cannot_train_a_run_is_refused() {
    let scratch = Scratch::with_room();
    for other in ["--preset paper --set precision=f64", "--preset paper --set candidates=5"] {
        let arguments = format!("train room --out out --device gpu {other}");
        scratch.run(&arguments).fails(2, &["--device gpu", "found none in these settings"]);
    }
}

#[cfg(feature = "gui")]
#[test]
fn a_gpu_trains_to_the_same_files() {
    if crate::common::adapter::vulkan().is_none() {
        return;
    }
    let scratch = Scratch::with_room();
    for (arguments, word) in [(PAPER, "passes"), ("--photometric off", "points")] {
        let (report_of_gpu, said) = report(&scratch, "gpu", &format!("{arguments} --device gpu"));
        report(&scratch, "cpu", &format!("{arguments} --device cpu"));
        let used = &report_of_gpu[word];
        // The first frame is fitted on both devices and compared; it counts as the CPU's.
        assert_eq!((&used["device_frames"], &used["processor_frames"]), (&2.into(), &1.into()));
        assert!(said.contains(&format!("{} fitted 2 frames", used["device"].as_str().unwrap())));
        assert!(scratch.bytes("gpu/scene.ply") == scratch.bytes("cpu/scene.ply"));
    }
}
