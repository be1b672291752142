//! What compares photographs, chosen on the command line.

use super::runner::Scratch;
use serde_json::Value;

/// The report's word, and the console's.
fn trained(arguments: &str) -> (Value, String) {
    let scratch = Scratch::with_room();
    let run = scratch.run(&format!("train room --out out --max-frames 3 {arguments}")).succeeds();
    (scratch.json("out/report.json")["comparer"].clone(), run.stdout)
}

#[test]
fn the_processor_compares_where_it_is_asked_to() {
    let (used, said) = trained("--photometric-device cpu");
    assert_eq!(used["device"], Value::Null);
    assert_eq!((&used["processor_frames"], &used["device_frames"]), (&3.into(), &0.into()));
    assert!(said.contains("the processor compared photographs"), "{said}");
    let (none, said) = trained("--photometric off");
    assert!(none.is_null() && !said.contains("photographs"), "{none} {said}");
}

#[test]
fn a_gpu_without_photographs_is_refused() {
    let scratch = Scratch::with_room();
    for without in ["--photometric off", "--preset paper --components 100"] {
        let arguments = format!("train room --out out --photometric-device gpu {without}");
        scratch
            .run(&arguments)
            .fails(2, &["--photometric-device gpu", "--photometric light or full"]);
    }
}

/// Asked for, a software adapter is as good as any.
#[cfg(feature = "gui")]
#[test]
fn a_gpu_compares_where_it_is_asked_to() {
    let Some(adapter) = crate::common::adapter::vulkan() else { return };
    let (used, said) = trained("--photometric full --photometric-device gpu");
    assert_eq!((&used["processor_frames"], &used["device_frames"]), (&0.into(), &3.into()));
    let name = used["device"].as_str().unwrap();
    assert!(said.contains(&format!("{name} compared photographs")), "{said}");
    if adapter.get_info().device_type == wgpu::DeviceType::Cpu {
        let (auto, _) = trained("--photometric full");
        assert_eq!(auto["device"], Value::Null, "software is never taken unasked");
    }
}
