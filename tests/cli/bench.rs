//! `bench` and `precision-search` through the binary.

use super::runner::Scratch;

#[test]
fn a_bench_writes_three_files_and_prints_its_table() {
    let scratch = Scratch::with_room();
    let options = "--quick --max-frames 2 --repeats 1 --out found";
    let run = scratch.run(&format!("bench pareto room {options}")).succeeds();
    assert!(run.stdout.contains("ms/frame") && run.stdout.contains("PSNR"), "{}", run.stdout);
    assert!(run.stdout.contains("wrote pareto.json, pareto.csv and pareto.png"), "{}", run.stdout);
    let json = scratch.json("found/pareto.json");
    assert_eq!(json["options"]["max_frames"], 2);
    let lines = scratch.bytes("found/pareto.csv").iter().filter(|b| **b == b'\n').count();
    assert_eq!(lines, json["rows"].as_array().unwrap().len() + 1);
    let plot = image::load_from_memory(&scratch.bytes("found/pareto.png")).unwrap().to_rgb8();
    assert_eq!(plot.dimensions(), (1200, 800));
    assert!(plot.pixels().any(|p| p.0 == [0, 114, 178]), "a mark of the first series");
    let printed = scratch.run(&format!("bench pareto room {options} --json")).succeeds().json();
    assert_eq!(printed["bench"], "pareto");
}

/// `bench paper` reuses stored results, unless the settings differ.
#[test]
fn the_papers_protocol_goes_on_where_it_stopped() {
    let scratch = Scratch::with_room();
    std::fs::create_dir(scratch.path("scenes")).unwrap();
    std::fs::create_dir(scratch.path("scenes/nothing")).unwrap();
    std::fs::rename(scratch.path("room"), scratch.path("scenes/room")).unwrap();
    let bench = "bench paper --data scenes --quick --out found --max-frames";
    let run = scratch.run(&format!("{bench} 2")).succeeds();
    assert!(run.stdout.contains("left out: scenes/nothing"), "{}", run.stdout);
    let json = scratch.json("found/paper.json");
    let rows = json["rows"].as_array().unwrap();
    let named =
        |row: &serde_json::Value| format!("{} {}", row["preset"], row["renderer"]).replace('"', "");
    let names: Vec<String> = rows.iter().map(named).collect();
    assert_eq!(names, ["paper projected", "paper exact", "scene projected", "scene exact"]);
    assert!(rows.iter().all(|row| row["frames"] == 2 && row["psnr"].as_f64().unwrap() > 5.0));
    let kept = scratch.path("found/paper/room-scene.json");
    let marked = std::fs::read_to_string(&kept).unwrap().replace("\"drawn\": ", "\"drawn\": 1");
    std::fs::write(&kept, marked).unwrap();
    scratch.run(&format!("{bench} 2")).succeeds();
    let again = scratch.json("found/paper.json");
    assert_eq!(again["rows"][0], rows[0], "times of another run would differ");
    assert_ne!(again["rows"][2]["drawn"], rows[2]["drawn"], "read from the stored results");
    scratch.run(&format!("{bench} 1")).succeeds();
    assert_eq!(scratch.json("found/paper.json")["rows"][2]["frames"], 1);
    scratch.run("bench paper --data found").fails(1, &["found: expected folders of scenes"]);
}

/// `bench views` has a row for every configuration and group of views, on recordings and synthetic scenes.
#[test]
fn views_on_the_path_and_from_the_side_are_scored() {
    let scratch = Scratch::with_room();
    std::fs::create_dir(scratch.path("scenes")).unwrap();
    std::fs::rename(scratch.path("room"), scratch.path("scenes/room")).unwrap();
    let run = scratch.run("bench views --data scenes --quick --out found").succeeds();
    assert!(run.stdout.contains("phone before a door"), "{}", run.stdout);
    let json = scratch.json("found/views.json");
    let rows = json["rows"].as_array().unwrap();
    for recording in ["room", "synthetic room", "phone before a door", "phone in a room"] {
        let mine = |group: &str| {
            let of =
                |row: &&serde_json::Value| row["recording"] == recording && row["group"] == group;
            rows.iter().filter(of).collect::<Vec<_>>()
        };
        let path = mine("new views");
        let names: Vec<&str> =
            path.iter().map(|row| row["configuration"].as_str().unwrap()).collect();
        assert_eq!(names, ["points alone", "no textures", "default", "full"], "{recording}");
        assert!(path.iter().all(|row| row["psnr"].as_f64().unwrap() > 8.0), "{path:?}");
        let differ = path[0]["psnr"] != path[2]["psnr"] && path[2]["psnr"] != path[3]["psnr"];
        assert!(differ, "{path:?}");
        let free = mine("free views");
        assert_eq!(free.len(), if recording == "room" { 0 } else { 4 }, "{recording}");
        // All of them: a phone's are in a folder of their own, beside views on its path.
        assert!(free.iter().all(|row| row["views"] == 3), "{free:?}");
        assert!(mine("sector").len() <= 4, "{recording}");
    }
    scratch.run("bench views --repeats 2").fails(2, &["--repeats: "]);
}

/// `bench retention` scores trained frames after training on them and again at the end.
#[test]
fn retention_is_of_frames_and_held_out_views() {
    let scratch = Scratch::with_room();
    let run = scratch.run("bench retention room --quick --out found").succeeds();
    assert!(run.stdout.contains("full, no accumulated precision"), "{}", run.stdout);
    let json = scratch.json("found/retention.json");
    let (rows, summary) = (json["rows"].as_array().unwrap(), json["summary"].as_array().unwrap());
    assert_eq!(summary.len(), 4);
    assert_eq!(rows.len() % 4, 0);
    for kept in summary {
        let of = |key: &str| {
            let mine = rows.iter().filter(|row| row["configuration"] == kept["configuration"]);
            let values: Vec<f64> = mine.map(|row| row[key].as_f64().unwrap()).collect();
            values.iter().sum::<f64>() / values.len() as f64
        };
        assert!((of("after") - kept["after"].as_f64().unwrap()).abs() < 1e-9, "{kept}");
        assert!((of("at_end") - kept["at_end"].as_f64().unwrap()).abs() < 1e-9, "{kept}");
        assert!(kept["held_out_fall"].as_f64().unwrap() >= 0.0);
    }
    scratch.run("bench retention room --repeats 2").fails(2, &["--repeats: "]);
}

/// Every table contains the preset; no table contains a change that has no effect on the dataset.
#[test]
fn accuracy_is_taken_apart() {
    let scratch = Scratch::with_room();
    let options = "--quick --max-frames 8 --repeats 2 --out found";
    let run = scratch.run(&format!("bench accuracy room {options}")).succeeds();
    for part in [
        "+ plane fit and its filter",
        "no colour gradient",
        "+ textures",
        "points alone, h =",
        "frames trained: 1;",
    ] {
        assert!(run.stdout.contains(part), "{part}: {}", run.stdout);
    }
    let json = scratch.json("found/accuracy.json");
    let rows = json["rows"].as_array().unwrap();
    let of_table = |name: &str| rows.iter().filter(|row| row["table"] == name).collect::<Vec<_>>();
    let [steps, changes, scales, budgets] =
        ["cumulative", "leave-one-out", "scale", "budget"].map(of_table);
    for (more, fewer) in budgets.iter().zip(&budgets[1..]) {
        assert!(more["drawn"].as_f64() > fewer["drawn"].as_f64(), "{more} {fewer}");
        let [more, fewer] = [more, fewer].map(|row| row["psnr"].as_f64().unwrap());
        assert!(fewer < more + 0.1, "fewer components must not score better: {fewer} {more}");
    }
    let preset = [steps[steps.len() - 1], changes[0], scales[0]];
    assert!(
        preset.iter().all(|row| row["psnr"] == preset[0]["psnr"] && row["h"] == preset[0]["h"])
    );
    // Exact depth, registered colour and constant exposure leave nothing to calibrate or fit.
    let names: Vec<&str> = rows.iter().map(|row| row["configuration"].as_str().unwrap()).collect();
    assert!(!names.iter().any(|name| name.contains("calibration") || name.contains("gain")));
    assert_eq!((steps.len(), scales.len()), (10, 4), "{names:?}");
    for row in scales {
        assert!(row["psnr_low"].as_f64() <= row["psnr_high"].as_f64(), "{row}");
        assert!(row["drawn"].as_f64() <= row["born"].as_f64() && row["drawn"] != 0.0, "{row}");
        assert!((0.0..=1.0).contains(&row["cracks_half_01"].as_f64().unwrap()), "{row}");
    }
    assert_eq!(json["summary"]["orders"], 2);
}

#[test]
fn frames_of_a_model_are_timed() {
    let scratch = Scratch::with_scene();
    let options = "--splats 50,5000 --size 64x48 --repeats 2 --device cpu --out found";
    let run = scratch.run(&format!("bench render out/scene.ply {options}")).succeeds();
    assert!(run.stdout.starts_with("out/scene.ply, "), "{}", run.stdout);
    assert!(run.stdout.contains("wrote render.json, render.csv and render.png"), "{}", run.stdout);
    let rows = scratch.json("found/render.json")["rows"].clone();
    let found: Vec<_> = rows.as_array().unwrap().iter().collect();
    let found: Vec<_> = found.iter().map(|row| (&row["splats"], &row["renderer"])).collect();
    let [few, many] = [50, 5000].map(serde_json::Value::from);
    let [projected, exact] = ["projected", "exact"].map(serde_json::Value::from);
    let expected = [(&few, &projected), (&few, &exact), (&many, &projected), (&many, &exact)];
    assert_eq!(found, expected);
}

#[test]
fn the_precision_found_is_what_train_uses() {
    let scratch = Scratch::with_room();
    let options = "--quick --components 300 --max-frames 2 --repeats 1 --out found";
    let run = scratch.run(&format!("precision-search room {options}")).succeeds();
    assert!(run.stdout.contains("train --preset paper --config"), "{}", run.stdout);
    scratch
        .run("train room --out out --preset paper --config found/precision-search.ron")
        .succeeds();
    let chosen = &scratch.json("found/precision-search.json")["chosen"]["operations"];
    assert_eq!(&scratch.json("out/report.json")["config"]["operations"], chosen);
}

#[test]
fn wrong_usage_is_said_before_any_work() {
    let scratch = Scratch::with_room();
    let parts = ["--bound", "expected a relative error above 0", "found 0"];
    scratch.run("precision-search room --bound 0").fails(2, &parts);
    let parts = ["none", "expected"];
    scratch.run("bench ablation none").fails(1, &parts);
    for (options, parts) in [
        ("none.ply", &["none.ply", "found nothing"][..]),
        ("--splats 0", &["--splats", "1 to 20000000"]),
        ("--splats 10,30000000", &["'30000000'", "--splats"]),
        ("--size 64", &["--size", "WIDTHxHEIGHT"]),
        ("--size 1x1,2x2,3x3,4x4,5x5", &["--size", "4 sizes at most", "found 5"]),
        ("--device tpu", &["'tpu'", "--device"]),
    ] {
        let code = if options.starts_with("--") { 2 } else { 1 };
        scratch.run(&format!("bench render {options}")).fails(code, parts);
    }
    if cfg!(feature = "gui") {
        let parts = ["--adapter", "--device gpu or all"];
        scratch.run("bench render --device cpu --adapter arc").fails(2, &parts);
    } else {
        scratch.run("bench render --device gpu").fails(2, &["'gpu'", "--device"]);
        scratch.run("bench render --adapter arc").fails(2, &["--adapter"]);
    }
    assert!(!scratch.path("vbgs-bench").exists(), "no output before the dataset is found");
}
