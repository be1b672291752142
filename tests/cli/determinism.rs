//! The same input gives the same bytes for any number of threads.

use super::runner::Scratch;

fn scene(scratch: &Scratch, options: &str) -> Vec<u8> {
    let train = format!("train room --out out --preset paper --set components=5000 {options}");
    scratch.run(&train).succeeds();
    scratch.bytes("out/scene.ply")
}

fn room() -> Scratch {
    let scratch = Scratch::empty();
    scratch.run("synth room --size 160x120 --frames 8 --eval-frames 1").succeeds();
    scratch
}

#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    let scratch = room();
    let cases = [("off", "mixed"), ("padded", "mixed"), ("forwarded", "mixed"), ("padded", "f64")];
    for (reassign, precision) in cases {
        let options = format!("--set reassign={reassign} --set precision={precision}");
        let one = scene(&scratch, &format!("{options} --threads 1"));
        let many = scene(&scratch, &format!("{options} --threads 3"));
        assert!(one == many, "{options}: three threads differ from one");
        assert_eq!(scratch.json("out/report.json")["machine"]["threads"], 3);
    }
}

/// The CPU's instruction set changes the time per frame and nothing else.
#[test]
fn any_instruction_set_gives_the_same_bytes() {
    let scratch = room();
    for reassign in ["off", "padded", "forwarded"] {
        let options = format!("--set reassign={reassign}");
        let best = scene(&scratch, &options);
        let train =
            format!("train room --out forced --preset paper --set components=5000 {options}");
        let words: Vec<&str> = train.split_whitespace().collect();
        let forced = scratch.command(&words).env("VBGS_SIMD", "portable").status().unwrap();
        assert!(forced.success());
        assert_eq!(scratch.json("forced/report.json")["machine"]["simd"], "portable");
        assert!(scratch.bytes("forced/scene.ply") == best, "{options}");
    }
}

#[test]
fn without_reassignment_the_order_of_frames_does_not_matter() {
    let scratch = room();
    let sequential = scene(&scratch, "--set reassign=off");
    let shuffled = scene(&scratch, "--set reassign=off --set order=shuffled");
    let frames = scratch.json("out/report.json")["frames"].clone();
    let order: Vec<&str> =
        frames.as_array().unwrap().iter().map(|f| f["frame"].as_str().unwrap()).collect();
    assert!(!order.is_sorted(), "the order was not shuffled: {order:?}");
    assert!(sequential == shuffled);
    assert!(
        sequential != scene(&scratch, "--set reassign=off --max-frames 7"),
        "every frame counts"
    );
}

#[test]
fn the_seed_changes_the_scene() {
    let scratch = room();
    let first = scene(&scratch, "--set seed=1");
    assert!(first == scene(&scratch, "--set seed=1"));
    assert!(first != scene(&scratch, "--set seed=2"));
}
