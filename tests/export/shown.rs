//! Formats that are written for other programs alone: a page for browsers, and USD.

use super::{random_splats, read_bytes, set, written, written_as};
use crate::common::scenes::random_appearance;
use glam::DVec3;
use vbgs_studio::export::{ModelFormat, SpzVersion, WriteOptions, read_back};

/// The page holds the splats as the SPZ of the same options.
#[test]
fn a_page_holds_a_viewer_its_view_and_the_splats() {
    let splats = random_splats(300, 181);
    let native = set(&splats, &random_appearance(&splats, 181));
    let page = String::from_utf8(written_as(ModelFormat::Html, &native)).unwrap();
    let between = |start: &str, end: &str| {
        page.split_once(start).unwrap().1.split_once(end).unwrap().0.to_owned()
    };
    let scene = between("<script id=\"scene\" type=\"text/plain\">", "</script>");
    let spz = base64::Engine::decode(&base64::engine::general_purpose::STANDARD, scene).unwrap();
    let options =
        WriteOptions { spz_version: SpzVersion::V3, ..WriteOptions::new(ModelFormat::Spz) };
    assert!(spz == written(&native, &options), "the page holds other splats");
    let view = between("<script id=\"view\" type=\"application/json\">", "</script>");
    let view: serde_json::Value = serde_json::from_str(&view).unwrap();
    let radius = view["radius"].as_f64().unwrap();
    assert!((50.0..500.0).contains(&radius), "{view}");
    assert!(!page.contains("{view}") && !page.contains("{generator}") && !page.contains("{scene}"));
    // Nothing is loaded from elsewhere.
    for word in ["http:", "https:", "import ", "src=", "href="] {
        assert!(!page.contains(word), "{word}");
    }
    assert!(page.trim_end().ends_with("</html>"));
}

/// Values of an array of numbers or tuples.
fn numbers(text: &str, name: &str) -> Vec<f64> {
    let (_, rest) = text.split_once(&format!("{name} = [")).unwrap();
    let list = rest.split_once(']').unwrap().0;
    let number = |part: &str| part.trim_matches([' ', '(', ')']).parse().unwrap();
    list.split(',').map(number).collect()
}

#[test]
fn usd_states_units_axes_and_every_attribute() {
    let splats = random_splats(40, 182);
    let native = set(&splats, &random_appearance(&splats, 182));
    let options = WriteOptions {
        metric: true,
        unit_scale: 100.0,
        local_origin: DVec3::new(1000.0, 2000.0, 3.0),
        ..WriteOptions::new(ModelFormat::Usda)
    };
    let text = String::from_utf8(written(&native, &options)).unwrap();
    assert!(text.starts_with("#usda 1.0\n"));
    for line in [
        "upAxis = \"Y\"",
        "metersPerUnit = 0.01",
        "defaultPrim = \"Splats\"",
        "def ParticleField3DGaussianSplat \"Splats\"",
        "uniform int radiance:sphericalHarmonicsDegree = 1\n",
        "double3 xformOp:translate = (100000, 300, -200000)",
        "uniform token[] xformOpOrder = [\"xformOp:translate\"]",
    ] {
        assert!(text.contains(line), "{line} is missing in {}", &text[..900]);
    }
    let n = |name: &str| numbers(&text, name).len();
    assert_eq!(
        [n("positions"), n("orientations"), n("scales"), n("opacities")],
        [120, 160, 120, 40]
    );
    assert_eq!(n("radiance:sphericalHarmonicsCoefficients"), 40 * 4 * 3);
    // Up is y, and lengths are centimetres.
    let positions = numbers(&text, "point3f[] positions");
    let glb = read_bytes(&written_as(ModelFormat::Glb, &native)).unwrap();
    let [x, y, z] = glb.splats[0].mean;
    for (found, expected) in positions.iter().zip([x, z, -y]) {
        assert!((found - 100.0 * f64::from(expected)).abs() < 1e-2, "{found} {expected}");
    }
    let plain = String::from_utf8(written_as(ModelFormat::Usda, &splats)).unwrap();
    assert!(
        plain.contains("sphericalHarmonicsDegree = 0\n") && plain.contains("metersPerUnit = 1\n")
    );
    assert!(!plain.contains("xformOp") && plain.contains("units unknown"));
}

/// Previews show the splats of files that are not read, with the size of the file.
#[test]
fn formats_without_a_reader_have_previews() {
    let splats = random_splats(50, 183);
    for (format, alike) in
        [(ModelFormat::Html, ModelFormat::Spz), (ModelFormat::Usda, ModelFormat::Glb)]
    {
        assert!(!format.is_read());
        let shown = read_back(&splats, &WriteOptions::new(format)).unwrap();
        let other = read_back(&splats, &WriteOptions::new(alike)).unwrap();
        assert!(shown.splats == other.splats, "{format}");
        assert_eq!(shown.bytes, written_as(format, &splats).len() as u64);
    }
}
