//! Second model for comparison, read on its own thread.

use crate::app::background_job::BackgroundJob;
use crate::app::opening::{BareSplats, OpenError, read_splats};
use crate::app::state::NoticeKind;
use crate::app::worker::Waker;
use crate::model::splat::appearance::SplatSet;
use crate::model::splat::framing::framing;
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Maximum length of a name in a caption, characters: the viewport of a small window is about 450
/// points wide.
const MAX_NAME: usize = 30;

/// Model compared with the scene.
#[derive(Clone, Debug)]
pub struct ComparedModel {
    /// File name with its folder, shortened for a caption.
    pub name: String,
    /// Path of the file.
    pub path: PathBuf,
    /// Splats, with positions relative to `local_origin`.
    pub splats: SplatSet,
    /// Origin of the positions, world coordinates.
    pub local_origin: DVec3,
    /// Radius of the model, world units; it determines the near plane.
    pub radius: f64,
}

impl ComparedModel {
    /// Re-expresses the positions relative to another origin.
    fn move_origin(&mut self, origin: DVec3) {
        let moved = self.local_origin - origin;
        for splat in self.splats.splats_mut() {
            splat.mean = (DVec3::from_array(splat.mean.map(f64::from)) + moved).as_vec3().into();
        }
        self.local_origin = origin;
    }
}

/// Notice for the user.
type NoticeText = (NoticeKind, String);

/// Model compared with the scene, and the one being read.
#[derive(Default)]
pub struct ModelSlot {
    model: Option<Arc<ComparedModel>>,
    reading: Option<Reading>,
}

struct Reading {
    path: PathBuf,
    job: BackgroundJob<Result<(ComparedModel, Vec<NoticeText>), String>>,
}

impl ModelSlot {
    /// Model, once it has been read.
    pub fn model(&self) -> Option<&Arc<ComparedModel>> {
        self.model.as_ref()
    }

    /// Starts reading a checkpoint or splat file; replaces a read in progress.
    pub fn read(&mut self, path: PathBuf, waker: Waker) -> std::io::Result<()> {
        let file = path.clone();
        let job = BackgroundJob::start("second model", waker, move || read(&file))?;
        self.reading = Some(Reading { path, job });
        Ok(())
    }

    /// Re-expresses the model relative to the scene's local origin, which may change with the dataset.
    pub fn rebase_to_origin(&mut self, origin: DVec3) {
        if let Some(model) = self.model.as_mut().filter(|model| model.local_origin != origin) {
            Arc::make_mut(model).move_origin(origin);
        }
    }

    /// Removes the model.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Takes a finished read: true if the model was replaced, and the notices. After an error the
    /// previous model stays.
    pub fn take_finished_read(&mut self) -> Option<(bool, Vec<NoticeText>)> {
        let reading = self.reading.as_ref()?;
        let read = reading.job.poll()?.unwrap_or_else(|panic| {
            Err(format!(
                "{}: {}",
                reading.path.display(),
                panic.failure_notice("reading the model")
            ))
        });
        self.reading = None;
        match read {
            Ok((model, told)) => {
                self.model = Some(Arc::new(model));
                Some((true, told))
            }
            Err(problem) => Some((false, vec![(NoticeKind::Error, problem)])),
        }
    }
}

fn read(path: &Path) -> Result<(ComparedModel, Vec<NoticeText>), String> {
    let read = read_splats(path).map_err(|error: OpenError| error.to_string())?;
    let BareSplats { splats, local_origin, notices: told } = read;
    let Some(framing) = framing(splats.iter()) else {
        return Err(format!(
            "{}: expected at least one splat, found none; compare with another file",
            path.display()
        ));
    };
    let model = ComparedModel {
        name: name_of(path),
        path: path.to_owned(),
        splats,
        local_origin,
        radius: framing.radius,
    };
    Ok((model, told))
}

/// Returns the file name with its folder, because the files of all runs have the same name. Only the
/// end of a long name is retained.
fn name_of(path: &Path) -> String {
    let file = path.file_name().unwrap_or_default().to_string_lossy();
    let folder = path.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy();
    let name = if folder.is_empty() { file.into_owned() } else { format!("{folder}/{file}") };
    let n = name.chars().count();
    if n <= MAX_NAME {
        return name;
    }
    let end: String = name.chars().skip(n + 1 - MAX_NAME).collect();
    format!("…{end}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::splat::splats::Splat;

    #[test]
    fn positions_follow_the_scenes_origin() {
        let far = DVec3::new(5e5, 5e6, 0.0);
        let splat = Splat { mean: [1.0, 2.0, 3.0], ..Splat::default() };
        let mut slot = ModelSlot {
            model: Some(Arc::new(ComparedModel {
                name: String::new(),
                path: PathBuf::new(),
                splats: SplatSet::from(vec![splat]),
                local_origin: far,
                radius: 1.0,
            })),
            reading: None,
        };
        slot.rebase_to_origin(far - DVec3::X);
        let model = slot.model().unwrap();
        assert_eq!(model.splats.view().splats()[0].mean, [2.0, 2.0, 3.0]);
        assert_eq!(model.local_origin, far - DVec3::X);
    }

    #[test]
    fn names_tell_runs_apart_and_fit_a_caption() {
        for (path, expected) in [
            ("/data/run-2/checkpoint.vbgs", "run-2/checkpoint.vbgs"),
            ("/scene.ply", "scene.ply"),
            ("/a/a long name of a folder/scene.ply", "…ng name of a folder/scene.ply"),
        ] {
            assert_eq!(name_of(Path::new(path)), expected);
            assert!(expected.chars().count() <= MAX_NAME);
        }
    }
}
