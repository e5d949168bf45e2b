//! An open file with its pages, layers, levels and faces.

use crate::colors::{Colors, Viewing};
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

/// The modification time and length of a file, to detect changes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stamp {
    modified: Option<SystemTime>,
    len: u64,
}

impl Stamp {
    /// Returns the stamp of a file; an empty one when there is no file.
    pub fn of(path: &Path) -> Self {
        match std::fs::metadata(path) {
            Ok(meta) => Self { modified: meta.modified().ok(), len: meta.len() },
            Err(_) => Self::default(),
        }
    }

    /// True when there is a file that is not empty.
    pub fn is_there(&self) -> bool {
        self.len > 0
    }
}

/// One image of a file, with all its levels.
#[derive(Clone, Debug)]
pub struct Page {
    /// The name in the file; "" when it has none.
    pub name: String,
    /// The description of each stored level.
    pub specs: Vec<ImageSpec>,
    /// The kind of texture.
    pub kind: TextureKind,
    /// Its channels in layers, at least one.
    pub layers: Vec<Layer>,
    /// The layout of its six faces, if it has any.
    pub layout: Option<CubeLayout>,
    /// Its pixels.
    pub pyramid: Arc<Pyramid>,
    /// True when integers are encoded colours, and false when they are linear.
    pub encoded: bool,
    /// Its colours.
    pub colors: Arc<Colors>,
}

/// An open file.
#[derive(Debug)]
pub struct Image {
    /// Its name.
    pub path: PathBuf,
    /// The format of the file.
    pub format: &'static str,
    /// Its images, at least one.
    pub pages: Vec<Arc<Page>>,
    /// The stamp of the file when it was opened.
    pub stamp: Stamp,
}

impl Page {
    /// Returns a page from any source of pixels.
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
        let colors = match kind.is_shadow() || layers.iter().all(|layer| layer.meaning != Meaning::Color) {
            true => Arc::default(),
            false => Arc::new(Colors::of(&specs[0])),
        };
        Self { name, specs, kind, layers, layout, pyramid, encoded, colors }
    }

    fn open(input: &Arc<dyn ImageInput>, image: usize, store: &TileStore) -> Option<Self> {
        let page = FilePage::new(input.clone(), image)?;
        let specs: Vec<ImageSpec> = (0..page.levels()).filter_map(|l| page.spec(l).cloned()).collect();
        let name = specs[0].string("name").unwrap_or_default().to_owned();
        Some(Self::build(name, specs, Arc::new(page), store, input.format_name()))
    }

    /// Returns the same pixels as a latitude-longitude panorama.
    #[must_use]
    pub fn as_panorama(&self) -> Self {
        Self { kind: TextureKind::LatLongEnvironment, layout: None, ..self.clone() }
    }

    /// Returns the same pixels with integers as encoded colours, or as linear values.
    #[must_use]
    pub fn with_encoding(&self, encoded: bool) -> Self {
        Self { encoded, colors: Arc::new(Colors::chosen(encoded)), ..self.clone() }
    }

    /// Returns the same pixels seen through a view of a display; `None` for an sRGB screen. Values that are no colours
    /// stay as they are. `file` is the name of the file.
    #[must_use]
    pub fn seen_through(&self, viewing: Option<&Viewing>, file: &str) -> Self {
        if self.colors.text.is_empty() {
            return self.clone();
        }
        let colors = match viewing {
            Some(viewing) => viewing.colors(self.spec(), file),
            None => Colors::of(self.spec()),
        };
        Self { colors: Arc::new(colors), ..self.clone() }
    }

    /// Returns the description of its largest level.
    pub fn spec(&self) -> &ImageSpec {
        &self.specs[0]
    }

    /// Returns the layout of its pixels.
    pub fn sheet(&self, arrangement: Arrangement, level: usize) -> Sheet {
        Sheet::new(arrangement, level, &self.specs, self.layout, &self.pyramid)
    }

    /// Returns its default arrangement, which is a cross if it has faces.
    pub fn arrangement(&self) -> Arrangement {
        if self.layout.is_some() { Arrangement::Cross } else { Arrangement::Stored }
    }

    /// True when it shows all directions around a point.
    pub fn is_panorama(&self) -> bool {
        self.layout.is_some() || self.kind == TextureKind::LatLongEnvironment
    }

    /// Returns the position of each face in every level. A latitude-longitude panorama counts as one face.
    pub(crate) fn face_rects(&self) -> Vec<Vec<[f64; 4]>> {
        match self.layout {
            Some(layout) => (0..6).map(|f| face_rects(layout, f, &self.specs, &self.pyramid)).collect(),
            None => self.sheet(Arrangement::Stored, 0).patches.into_iter().map(|p| p.source).collect(),
        }
    }

    /// True when a layer contains depths.
    pub fn is_depth(&self, layer: usize) -> bool {
        self.layers.get(layer).is_some_and(|l| l.meaning == Meaning::Depth)
    }

    /// Returns the reading errors so far.
    pub fn fault(&self) -> Option<String> {
        self.pyramid.source().fault()
    }
}

impl Image {
    /// Opens a file of any format. `file#2` is its third image. No pixels are read.
    ///
    /// # Errors
    /// Returns an error when it cannot be opened or has no pixels.
    pub fn open(path: &Path, formats: &FormatRegistry, store: &TileStore) -> Result<Self> {
        // The stamp is taken before the file is opened, so that a change in between is detected afterwards.
        let stamp = Stamp::of(path);
        let input: Arc<dyn ImageInput> = Arc::from(formats.open(path)?);
        let pages: Vec<Arc<Page>> =
            (0..input.images()).filter_map(|image| Page::open(&input, image, store)).map(Arc::new).collect();
        if pages.is_empty() {
            let what = format!("{}: there is no image in it that can be shown", path.display());
            return Err(ViewError::Misuse { what });
        }
        Ok(Self { path: path.to_owned(), format: input.format_name(), pages, stamp })
    }

    /// Shows its images through a view of a display; `None` for an sRGB screen.
    pub fn see_through(&mut self, viewing: Option<&Viewing>) {
        let file = self.path.to_string_lossy();
        for page in &mut self.pages {
            *page = Arc::new(page.seen_through(viewing, &file));
        }
    }

    /// True when the file has changed since it was opened.
    pub fn has_changed(&self) -> bool {
        let now = Stamp::of(&self.path);
        now.is_there() && now != self.stamp
    }
}
