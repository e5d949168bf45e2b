//! An open file as people see it: pages, layers, levels, faces.

use crate::layers::{Layer, Meaning};
use crate::pyramid::Pyramid;
use crate::sheet::{Arrangement, Sheet, face_rects};
use crate::source::{FilePage, Source};
use crate::store::TileStore;
use crate::{Result, ViewError};
use granita_image::{FormatRegistry, ImageInput, ImageSpec};
use granita_texture::{CubeLayout, TextureKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

/// When a file was written and how long it is: whether it changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stamp {
    modified: Option<SystemTime>,
    len: u64,
}

impl Stamp {
    /// That of a file as it is now; that of no file when there is none.
    pub fn of(path: &Path) -> Self {
        match std::fs::metadata(path) {
            Ok(meta) => Self { modified: meta.modified().ok(), len: meta.len() },
            Err(_) => Self::default(),
        }
    }

    /// Whether there is a file with something in it.
    pub fn is_there(&self) -> bool {
        self.len > 0
    }
}

/// One image of a file, with all its levels.
#[derive(Clone, Debug)]
pub struct Page {
    /// Name in the file; "" when it has none.
    pub name: String,
    /// Description of each stored level.
    pub specs: Vec<ImageSpec>,
    /// What it is for.
    pub kind: TextureKind,
    /// Its channels in groups, at least one.
    pub layers: Vec<Layer>,
    /// How its six faces lie, if it has any.
    pub layout: Option<CubeLayout>,
    /// Its pixels.
    pub pyramid: Arc<Pyramid>,
    /// Whether integers are colours as screens take them, rather than in proportion to light.
    pub encoded: bool,
}

/// An open file.
#[derive(Debug)]
pub struct Picture {
    /// Its name.
    pub path: PathBuf,
    /// The format that it turned out to have.
    pub format: &'static str,
    /// Its images, at least one.
    pub pages: Vec<Arc<Page>>,
    /// The file that was opened.
    pub stamp: Stamp,
}

impl Page {
    /// A page from any source of pixels.
    pub fn from_source(name: &str, spec: ImageSpec, source: Arc<dyn Source>, store: &TileStore) -> Self {
        Self::build(name.to_owned(), vec![spec], source, store, "")
    }

    fn build(
        name: String,
        specs: Vec<ImageSpec>,
        source: Arc<dyn Source>,
        store: &TileStore,
        format: &str,
    ) -> Self {
        let mut kind = TextureKind::of(&specs[0]);
        if kind == TextureKind::VolumeShadow && specs[0].nchannels() < 4 {
            kind = TextureKind::Shadow;
        }
        let layout = CubeLayout::of_format(format);
        let layout = Some(layout).filter(|l| kind.is_cube() && l.face_size(&specs[0]).is_some());
        let layers = Layer::of(&specs[0], kind);
        let reduce = Layer::reductions(&layers, specs[0].nchannels());
        let pyramid = Arc::new(Pyramid::new(source, store, reduce));
        let bytes = specs[0].pixel_type.bytes();
        let integers =
            matches!(specs[0].pixel_type, granita_image::PixelType::U8 | granita_image::PixelType::U16);
        let encoded = integers && bytes <= 2 && !kind.is_shadow();
        Self { name, specs, kind, layers, layout, pyramid, encoded }
    }

    fn open(input: &Arc<dyn ImageInput>, image: usize, store: &TileStore) -> Option<Self> {
        let page = FilePage::new(input.clone(), image)?;
        let specs: Vec<ImageSpec> = (0..page.levels()).filter_map(|l| page.spec(l).cloned()).collect();
        let name = specs[0].string("name").unwrap_or_default().to_owned();
        Some(Self::build(name, specs, Arc::new(page), store, input.format_name()))
    }

    /// The same pixels, taken as a panorama by latitude and longitude.
    #[must_use]
    pub fn as_panorama(&self) -> Self {
        Self { kind: TextureKind::LatLongEnvironment, layout: None, ..self.clone() }
    }

    /// The same pixels, their integers taken as colours for a screen, or as in proportion to light.
    #[must_use]
    pub fn with_encoding(&self, encoded: bool) -> Self {
        Self { encoded, ..self.clone() }
    }

    /// Description of its largest level.
    pub fn spec(&self) -> &ImageSpec {
        &self.specs[0]
    }

    /// Its pixels laid out.
    pub fn sheet(&self, arrangement: Arrangement, level: usize) -> Sheet {
        Sheet::new(arrangement, level, &self.specs, self.layout, &self.pyramid)
    }

    /// What it is first seen as: a cross if it has faces.
    pub fn arrangement(&self) -> Arrangement {
        if self.layout.is_some() { Arrangement::Cross } else { Arrangement::Stored }
    }

    /// Whether it shows all directions around a point, so that one can look around.
    pub fn is_panorama(&self) -> bool {
        self.layout.is_some() || self.kind == TextureKind::LatLongEnvironment
    }

    /// Where each face is in every level; for a panorama by latitude and longitude, of all of it.
    pub(crate) fn face_rects(&self) -> Vec<Vec<[f64; 4]>> {
        match self.layout {
            Some(layout) => (0..6).map(|f| face_rects(layout, f, &self.specs, &self.pyramid)).collect(),
            None => self.sheet(Arrangement::Stored, 0).patches.into_iter().map(|p| p.source).collect(),
        }
    }

    /// Whether a layer is of distances.
    pub fn is_depth(&self, layer: usize) -> bool {
        self.layers.get(layer).is_some_and(|l| l.meaning == Meaning::Depth)
    }

    /// What could not be read so far.
    pub fn fault(&self) -> Option<String> {
        self.pyramid.source().fault()
    }
}

impl Picture {
    /// Opens a file, whatever its format; `file#2` is its third image. No pixels are read.
    ///
    /// # Errors
    /// When it cannot be opened or has no pixels.
    pub fn open(path: &Path, formats: &FormatRegistry, store: &TileStore) -> Result<Self> {
        // Before it is opened: a change while that happens is seen afterwards.
        let stamp = Stamp::of(path);
        let input: Arc<dyn ImageInput> = Arc::from(formats.open(path)?);
        let pages: Vec<Arc<Page>> =
            (0..input.images()).filter_map(|image| Page::open(&input, image, store)).map(Arc::new).collect();
        if pages.is_empty() {
            let what = format!("{}: there is no picture in it that can be shown", path.display());
            return Err(ViewError::Misuse { what });
        }
        Ok(Self { path: path.to_owned(), format: input.format_name(), pages, stamp })
    }

    /// Whether the file is another one by now.
    pub fn has_changed(&self) -> bool {
        let now = Stamp::of(&self.path);
        now.is_there() && now != self.stamp
    }
}
