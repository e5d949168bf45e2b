//! Stanford PLY. A file becomes one mesh, or particles when there are no faces.

mod faces;
mod header;
mod values;
mod vertices;

use crate::emit::{Emit, positions};
use crate::faults::Faults;
use crate::source::{Opened, Stream, io_error, open};
use crate::text::Lines;
use faces::{FacePlan, Faces, Wrong};
use granita_base::{Params, Reporter, ShapeDesc};
use granita_scene::{Generator, GeneratorError, GeneratorSource, SceneSink};
use header::{Element, Encoding, Header, HeaderReader, Kind, Scalar};
use values::{Ascii, Binary, Fault, Values};
use vertices::Vertices;

/// Reads `.ply` files.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ply;

impl Generator for Ply {
    fn name(&self) -> &'static str {
        "ply"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["ply"]
    }

    fn run(
        &self,
        source: &GeneratorSource,
        sink: &mut dyn SceneSink,
        reporter: &Reporter,
    ) -> Result<(), GeneratorError> {
        let Opened { name, stream, size } = open(source)?;
        let mut lines = Lines::new(stream, false);
        let header = read_header(&name, &mut lines)?;
        let mut reader = Reader {
            faults: Faults::new(reporter, name.clone()),
            size,
            vertices: None,
            vertex_count: header.elements.iter().find(|e| e.name == "vertex").map_or(0, |e| e.count),
            faces: Faces::default(),
            wants_faces: false,
        };
        let result = match header.encoding {
            Encoding::Ascii => reader.elements(&header, &mut Ascii::new(lines)),
            Encoding::LittleEndian => {
                let (ahead, stream) = lines.into_rest();
                reader.elements(&header, &mut Binary::<_, false>::new(ahead, stream))
            }
            Encoding::BigEndian => {
                let (ahead, stream) = lines.into_rest();
                reader.elements(&header, &mut Binary::<_, true>::new(ahead, stream))
            }
        };
        // The elements that were read before an error are valid.
        reader.emit(&mut Emit::new(sink, name.clone()).smoothing())?;
        result.map_err(|error| io_error(&name, error))
    }
}

fn read_header(name: &str, lines: &mut Lines<Box<dyn Stream>>) -> Result<Header, GeneratorError> {
    let mut reader = HeaderReader::default();
    loop {
        match lines.next_line() {
            Ok(Some((line, text))) => match reader.line(text) {
                Ok(Some(header)) => return Ok(header),
                Ok(None) => {}
                Err(what) => return Err(GeneratorError::Malformed(format!("{name}:{line}: {what}"))),
            },
            Ok(None) => {
                let what =
                    if lines.line() == 1 { "the file is empty" } else { "the file ends in its header" };
                return Err(GeneratorError::Malformed(format!("{name}:{}: {what}", lines.line())));
            }
            Err(error) => return Err(io_error(name, error)),
        }
    }
}

/// Skips a list.
fn skip_list(values: &mut impl Values, count: Scalar, item: Scalar) -> Result<(), Fault> {
    let length = values.value(count)?;
    // A list with an invalid length has no values to skip.
    let length = if length >= 0.0 { length as u64 } else { 0 };
    for _ in 0..length {
        values.value(item)?;
    }
    Ok(())
}

struct Reader<'a> {
    faults: Faults<'a>,
    size: u64,
    vertices: Option<Vertices>,
    vertex_count: u64,
    faces: Faces,
    /// True when the file declares faces, so that its vertices are not particles.
    wants_faces: bool,
}

impl Reader<'_> {
    fn elements(&mut self, header: &Header, values: &mut impl Values) -> std::io::Result<()> {
        self.wants_faces = header.elements.iter().any(|e| is_faces(e) && e.count > 0);
        if !header.elements.iter().any(|e| e.name == "vertex") {
            self.faults.error("no vertices", 0, || "no element \"vertex\": nothing to draw".into());
            return Ok(());
        }
        for element in &header.elements {
            if element.properties.is_empty() {
                continue;
            }
            let read = match element.name.as_str() {
                "vertex" if self.vertices.is_none() => self.vertices(element, header.encoding, values),
                _ if is_faces(element) => self.faces(element, header.encoding, values),
                _ => skip(element, values),
            };
            match read {
                Ok(()) => {}
                Err((_, Fault::Io(error))) => return Err(error),
                Err((_, Fault::Lost)) => break,
                Err((done, _)) => {
                    let (name, count) = (&element.name, element.count);
                    self.faults.error("end", values.line(), || {
                        format!("the file ends after {done} of {count} elements \"{name}\"")
                    });
                    break;
                }
            }
        }
        Ok(())
    }

    fn vertices(
        &mut self,
        element: &Element,
        encoding: Encoding,
        values: &mut impl Values,
    ) -> Result<(), (u64, Fault)> {
        let Some(mut vertices) = Vertices::new(element, encoding, self.size) else {
            self.faults.error("positions", 0, || "vertices without the properties x, y and z".into());
            return skip(element, values);
        };
        let mut result = Ok(());
        for i in 0..element.count {
            match vertices.read(element, values) {
                Ok(true) => {}
                Ok(false) => self.faults.error("vertex", values.line(), || {
                    format!("vertex {i} has too few numbers, or none that are finite: left out")
                }),
                Err(fault) => {
                    result = Err((i, fault));
                    break;
                }
            }
        }
        self.vertices = Some(vertices);
        result
    }

    fn faces(
        &mut self,
        element: &Element,
        encoding: Encoding,
        values: &mut impl Values,
    ) -> Result<(), (u64, Fault)> {
        let Some(plan) = FacePlan::new(element) else {
            let name = &element.name;
            self.faults.error("lists", 0, || format!("element \"{name}\" has no list \"vertex_indices\""));
            return skip(element, values);
        };
        let strips = element.name == "tristrips";
        let vertices = self.vertex_count;
        for i in 0..element.count {
            let read = if strips {
                self.faces.read_strips(&plan, element, vertices, values)
            } else {
                self.faces.read(&plan, element, vertices, values)
            };
            let wrong = match read {
                Ok(Ok(())) => continue,
                Ok(Err(wrong)) => wrong,
                Err(Fault::Short) => Wrong::Short,
                Err(fault) => return Err((i, fault)),
            };
            let (line, what) = (values.line(), if strips { "strip" } else { "face" });
            match wrong {
                Wrong::Short => {
                    self.faults.error("short", line, || format!("{what} {i} has too few numbers: left out"));
                }
                Wrong::Few(n) => self
                    .faults
                    .error("few", line, || format!("{what} {i} has {n} of at least 3 vertices: left out")),
                Wrong::Vertex(v) => self.faults.error("index", line, || {
                    format!("{what} {i} refers to vertex {v}, of {vertices} from 0 on: left out")
                }),
                Wrong::Length(n) => {
                    let binary = encoding != Encoding::Ascii;
                    let result = if binary { "the rest cannot be read" } else { "left out" };
                    self.faults
                        .error("length", line, || format!("{what} {i} has a list of {n} values: {result}"));
                    if binary {
                        return Err((i, Fault::Lost));
                    }
                }
            }
        }
        Ok(())
    }

    fn emit(mut self, emit: &mut Emit<'_>) -> Result<(), GeneratorError> {
        let Some(mut vertices) = self.vertices.take() else { return Ok(()) };
        if !self.wants_faces {
            vertices.drop_faulty();
            let n = vertices.len();
            if n == 0 {
                return Ok(());
            }
            let mut params = Params(vec![positions(std::mem::take(&mut vertices.p))]);
            params.0.push(vertices.take_width().unwrap_or_else(vertices::default_width));
            params.0.extend(vertices.params(false));
            return Ok(emit.shape(ShapeDesc::Points { n }, params, 0)?);
        }
        self.faces.check_columns();
        let n = vertices.len();
        // This includes vertices that are missing because the file ends early.
        let p = &vertices.p;
        let good = |v: i32| (v as usize) < n && !p[3 * v as usize].is_nan();
        if vertices.faulty || (n as u64) < self.vertex_count {
            let dropped = self.faces.retain(good);
            if dropped > 0 {
                self.faults.error("faulty vertex", 0, || {
                    format!("{dropped} faces refer to vertices that were left out, and are left out too")
                });
            }
        }
        if self.faces.nverts.is_empty() {
            return Ok(());
        }
        vertices.bury_faulty();
        let mut params = Params(vec![positions(std::mem::take(&mut vertices.p))]);
        let (wedges, face_colors) = (self.faces.has_texcoords(), self.faces.has_colors());
        // Colours of faces take precedence. The colours of vertices may only be their mean.
        params.0.extend(vertices.params(wedges).filter(|p| !(face_colors && &*p.name == "C")));
        params.0.extend(self.faces.params());
        let Faces { nverts, verts, line, .. } = self.faces;
        let shape = ShapeDesc::Mesh { subdivide: false, nverts: nverts.into(), verts: verts.into() };
        Ok(emit.shape(shape, params, line)?)
    }
}

fn is_faces(element: &Element) -> bool {
    matches!(element.name.as_str(), "face" | "tristrips")
}

/// Skips an element that is not used.
fn skip(element: &Element, values: &mut impl Values) -> Result<(), (u64, Fault)> {
    for i in 0..element.count {
        let mut one = || {
            values.begin()?;
            for property in &element.properties {
                match property.kind {
                    Kind::Scalar(ty) => drop(values.value(ty)?),
                    Kind::List { count, item } => skip_list(values, count, item)?,
                }
            }
            Ok(())
        };
        match one() {
            Ok(()) | Err(Fault::Short) => {}
            Err(fault) => return Err((i, fault)),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
