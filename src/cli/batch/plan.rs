//! The items of a batch in their order, whatever is done of them already.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use impasto::scene::is_picture;
use impasto_scene::PictureFolder;

use super::file::{JobsFile, RenderTable, TrainTable};
use crate::cli::CliError;
use crate::cli::painting::PaintingSource;
use crate::cli::render::{FRAMES, ViewSource};

/// Everything to do. Items are numbered: models to train first, then renders.
#[derive(Debug)]
pub struct BatchPlan {
    /// Models to train, item `i` the `i`-th.
    pub trains: Vec<TrainTable>,
    /// Renders, by model, so that each is loaded once.
    pub models: Vec<ModelWork>,
}

/// All renders of one model.
#[derive(Debug)]
pub struct ModelWork {
    /// The model's folder.
    pub path: PathBuf,
    /// The paintings that any render is in.
    pub styles: Vec<StyleSource>,
    /// Renders, by views.
    pub groups: Vec<ViewGroup>,
}

/// A painting, or the photos' own look.
#[derive(Debug, Clone, PartialEq)]
pub struct StyleSource {
    /// What it is called.
    pub name: String,
    /// Where it comes from; none for the photos' own look.
    pub painting: Option<PaintingSource>,
}

/// Renders of one model from the same views: geometry is computed once for all.
#[derive(Debug)]
pub struct ViewGroup {
    /// A running number.
    pub turn: usize,
    /// What the views are called.
    pub name: String,
    /// From where.
    pub views: ViewSource,
    /// The table that asks for it.
    pub table: Rc<RenderTable>,
    /// One per style.
    pub items: Vec<RenderItem>,
}

/// One folder of frames.
#[derive(Debug)]
pub struct RenderItem {
    /// The item's number.
    pub number: usize,
    /// Which of [`ModelWork::styles`].
    pub style: usize,
    /// The folder.
    pub output: PathBuf,
}

impl ViewGroup {
    /// Number of frames, where that does not depend on the model or on a file.
    pub fn known_frames(&self) -> Option<usize> {
        match self.views {
            ViewSource::Orbit | ViewSource::Spiral => Some(self.table.frames.unwrap_or(FRAMES)),
            _ => None,
        }
    }
}

impl BatchPlan {
    /// Puts a file's items in order; `path` is only told.
    pub fn new(file: JobsFile, path: &Path) -> Result<Self, CliError> {
        let refuse = |problem: String| CliError::Refused(format!("{}: {problem}", path.display()));
        let mut plan = Self {
            trains: file.train,
            models: Vec::new(),
        };
        for table in file.render {
            plan.add(table).map_err(refuse)?;
        }
        if plan.trains.is_empty() && plan.models.is_empty() {
            let problem = "there is nothing to do in it; give it a [[render]] or [[train]] table";
            return Err(refuse(problem.into()));
        }
        plan.number();
        plan.check_apart().map_err(refuse)?;
        Ok(plan)
    }

    fn add(&mut self, table: RenderTable) -> Result<(), String> {
        let styles = styles(&table)?;
        if table.side_by_side && (table.styles.is_none() || table.depth) {
            return Err("side_by_side needs styles, and goes without depth".into());
        }
        let table = Rc::new(table);
        for path in &table.models {
            let at = self.models.iter().position(|work| work.path == *path);
            let at = at.unwrap_or_else(|| {
                self.models.push(ModelWork {
                    path: path.clone(),
                    styles: Vec::new(),
                    groups: Vec::new(),
                });
                self.models.len() - 1
            });
            self.models[at].add(&table, &styles)?;
        }
        Ok(())
    }

    fn number(&mut self) {
        let mut number = self.trains.len();
        let groups = self.models.iter_mut().flat_map(|work| &mut work.groups);
        for (turn, group) in groups.enumerate() {
            group.turn = turn;
            for item in &mut group.items {
                item.number = number;
                number += 1;
            }
        }
    }

    /// No two items may write to the same place.
    fn check_apart(&self) -> Result<(), String> {
        let renders = self.models.iter().flat_map(ModelWork::items);
        let outputs =
            (self.trains.iter().map(|train| &train.model)).chain(renders.map(|item| &item.output));
        let mut taken = HashMap::new();
        for (number, output) in outputs.enumerate() {
            if let Some(first) = taken.insert(output, number) {
                return Err(format!(
                    "items {first} and {number} both write to {}; tell them apart by {{model}}, \
                     {{style}} and {{views}} in output, or by other file names",
                    output.display()
                ));
            }
        }
        Ok(())
    }
}

impl ModelWork {
    /// All renders.
    pub fn items(&self) -> impl Iterator<Item = &RenderItem> {
        self.groups.iter().flat_map(|group| &group.items)
    }

    fn add(&mut self, table: &Rc<RenderTable>, styles: &[StyleSource]) -> Result<(), String> {
        let model = name_of(&self.path);
        for views in &table.views {
            let name = name_of(Path::new(views));
            let source = views
                .parse()
                .map_err(|problem| format!("views \"{views}\": {problem}"))?;
            let items = styles.iter().map(|style| {
                Ok(RenderItem {
                    number: 0,
                    style: self.style(style),
                    output: filled(&table.output, &model, &style.name, &name)?,
                })
            });
            let items = items.collect::<Result<_, String>>()?;
            self.groups.push(ViewGroup {
                turn: 0,
                name,
                views: source,
                table: Rc::clone(table),
                items,
            });
        }
        Ok(())
    }

    /// The style's place in the list, where each is once.
    fn style(&mut self, style: &StyleSource) -> usize {
        let known = self.styles.iter().position(|known| known == style);
        known.unwrap_or_else(|| {
            self.styles.push(style.clone());
            self.styles.len() - 1
        })
    }
}

/// A file's or folder's name without its ending.
fn name_of(path: &Path) -> String {
    let name = if path.is_dir() {
        path.file_name()
    } else {
        path.file_stem()
    };
    name.unwrap_or_default().to_string_lossy().into_owned()
}

/// The styles of a table. The names depend on nothing but the files' own, so that a painting more
/// changes no other's output.
fn styles(table: &RenderTable) -> Result<Vec<StyleSource>, String> {
    let Some(paths) = &table.styles else {
        return Ok(vec![StyleSource {
            name: "photo".into(),
            painting: None,
        }]);
    };
    let mut found = Vec::new();
    for path in paths {
        if !path.is_dir() {
            let painting = PaintingSource::named(&path.to_string_lossy(), Path::new(""))?;
            found.push(StyleSource {
                name: painting.stem(),
                painting: Some(painting),
            });
            continue;
        }
        let before = found.len();
        let folder = PictureFolder::walk(path)
            .map_err(|error| format!("styles {}: {error}", path.display()))?;
        for file in folder.files {
            let stem = Path::new(&file.name).with_extension("");
            if is_picture(&file.path) {
                found.push(StyleSource {
                    // A sub-folder's painting has no sub-folder of its own.
                    name: stem.to_string_lossy().replace(['/', '\\'], "-"),
                    painting: Some(PaintingSource::File(file.path)),
                });
            }
        }
        if found.len() == before {
            return Err(format!(
                "styles {}: there is no picture in it",
                path.display()
            ));
        }
    }
    Ok(found)
}

/// A render's folder.
fn filled(pattern: &str, model: &str, style: &str, views: &str) -> Result<PathBuf, String> {
    let mut path = String::new();
    let mut rest = pattern;
    while let Some((before, after)) = rest.split_once('{') {
        let (key, after) = after.split_once('}').unwrap_or((after, ""));
        path += before;
        path += match key {
            "model" => model,
            "style" => style,
            "views" => views,
            _ => {
                return Err(format!(
                    "output \"{pattern}\": there is no {{{key}}}; use {{model}}, {{style}} and {{views}}"
                ));
            }
        };
        rest = after;
    }
    Ok((path + rest).into())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(text: &str) -> Result<BatchPlan, String> {
        let file = toml::from_str(text).unwrap();
        BatchPlan::new(file, Path::new("jobs.toml")).map_err(|e| e.to_string())
    }

    fn outputs(plan: &BatchPlan) -> Vec<(usize, String)> {
        let items = plan.models.iter().flat_map(ModelWork::items);
        items
            .map(|item| (item.number, item.output.display().to_string()))
            .collect()
    }

    #[test]
    fn items_are_numbered_by_model_views_and_style() {
        let text = "[[train]]\nscene = \"s\"\nmodel = \"a\"\n\
            [[render]]\nmodels = [\"a\", \"b\"]\nstyles = [\"x.png\", \"y.jpg\"]\nviews = [\"orbit\", \"test\"]\n\
            [[render]]\nmodels = [\"a\"]\nframes = 3\noutput = \"plain-{model}\"\n";
        let plan = plan(text).unwrap();
        let wanted = [
            "out/a/x/orbit",
            "out/a/y/orbit",
            "out/a/x/test",
            "out/a/y/test",
            "plain-a",
            "out/b/x/orbit",
            "out/b/y/orbit",
            "out/b/x/test",
            "out/b/y/test",
        ];
        let wanted = wanted.iter().enumerate();
        let wanted: Vec<_> = wanted.map(|(i, w)| (i + 1, w.to_string())).collect();
        assert_eq!(outputs(&plan), wanted);
        let frames: Vec<_> = plan.models[0]
            .groups
            .iter()
            .map(ViewGroup::known_frames)
            .collect();
        assert_eq!(frames, [Some(FRAMES), None, Some(3)]);
    }

    #[test]
    fn two_items_in_one_place_are_refused() {
        let text =
            "[[render]]\nmodels = [\"a\"]\nstyles = [\"x.png\", \"y.jpg\"]\noutput = \"{model}\"\n";
        let problem = plan(text).unwrap_err();
        assert!(problem.contains("items 0 and 1"), "{problem}");
        let problem = plan("[[render]]\nmodels = [\"a\"]\noutput = \"{modle}\"\n").unwrap_err();
        assert!(problem.contains("{modle}"), "{problem}");
        let problem = plan("[[render]]\nmodels = [\"a\"]\nviews = [\"around\"]\n").unwrap_err();
        assert!(problem.contains("around"), "{problem}");
        assert!(plan("").unwrap_err().contains("nothing to do"));
    }

    #[test]
    fn a_number_is_a_painting() {
        let made = plan("[[render]]\nmodels = [\"m\"]\nstyles = [\"random:42\"]\n").unwrap();
        assert_eq!(outputs(&made)[0].1, "out/m/random-42/orbit");
        let styles = &made.models[0].styles;
        assert_eq!(styles[0].painting, Some(PaintingSource::Generated(42)));
        let problem = plan("[[render]]\nmodels = [\"m\"]\nstyles = [\"random:x\"]\n").unwrap_err();
        assert!(problem.contains("random:x"), "{problem}");
    }

    #[test]
    fn side_by_side_needs_styles() {
        let plain = "[[render]]\nmodels = [\"m\"]\nside_by_side = true\n";
        let styled = format!("{plain}styles = [\"random:1\"]\n");
        assert!(plan(plain).unwrap_err().contains("needs styles"));
        assert!(
            plan(&format!("{styled}depth = true\n"))
                .unwrap_err()
                .contains("without depth")
        );
        assert!(
            plan(&styled).unwrap().models[0].groups[0]
                .table
                .side_by_side
        );
    }

    #[test]
    fn a_folder_of_paintings_gives_its_pictures() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("deep")).unwrap();
        for name in ["b.png", "notes.txt", "deep/a.JPG"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let table = |path: &Path| format!("[[render]]\nmodels = [\"m\"]\nstyles = [{path:?}]\n");
        let plan_of = plan(&table(folder.path())).unwrap();
        let names: Vec<_> = outputs(&plan_of)
            .into_iter()
            .map(|(_, path)| path)
            .collect();
        assert_eq!(names, ["out/m/b/orbit", "out/m/deep-a/orbit"]);
        std::fs::create_dir(folder.path().join("none")).unwrap();
        assert!(plan(&table(&folder.path().join("none"))).is_err());
    }
}
