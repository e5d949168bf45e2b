//! STL, as text and as binary data. A file becomes one mesh, whose triangles share the vertices at one position.

use crate::emit::{Emit, positions};
use crate::faults::Faults;
use crate::source::{Opened, Stream, io_error, open};
use crate::text::{Lines, Words};
use granita_base::{Params, Reporter, ShapeDesc};
use granita_scene::{Generator, GeneratorError, GeneratorSource, SceneSink};
use std::collections::HashMap;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::sync::Arc;

/// The number of bytes before the first triangle of binary data: a title, and the number of triangles.
const HEADER: u64 = 84;
/// The number of bytes of a triangle: its normal, three vertices, and two bytes without a meaning.
const TRIANGLE: u64 = 50;

/// Reads `.stl` files.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stl;

impl Generator for Stl {
    fn name(&self) -> &'static str {
        "stl"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &["stl"]
    }

    fn run(
        &self,
        source: &GeneratorSource,
        sink: &mut dyn SceneSink,
        reporter: &Reporter,
    ) -> Result<(), GeneratorError> {
        let Opened { name, mut stream, size } = open(source)?;
        let fail = |error| io_error(&name, error);
        let mut header = [0; HEADER as usize];
        let length = size.min(HEADER) as usize;
        stream.read_exact(&mut header[..length]).map_err(fail)?;
        let count = u32::from_le_bytes([header[80], header[81], header[82], header[83]]);
        // Binary files may begin with the word of text files, too. Their size tells them apart.
        let fits = size == HEADER + TRIANGLE * u64::from(count);
        let is_text = header[..length].trim_ascii_start().starts_with(b"solid");
        let mut mesh = Welded::new(reporter, name.clone());
        let read = if is_text && !(size >= HEADER && fits) {
            stream.seek(SeekFrom::Start(0)).map_err(fail)?;
            mesh.text(stream)
        } else if size < HEADER {
            let what =
                format!("{name}: {size} bytes are neither text (\"solid\") nor the header of binary data");
            return Err(GeneratorError::Malformed(what));
        } else {
            mesh.binary(stream, u64::from(count))
        };
        // The triangles that were read before an error are valid.
        mesh.emit(&mut Emit::new(sink, name.clone()).smoothing())?;
        read.map_err(fail)
    }
}

/// Triangles that share vertices.
struct Welded<'a> {
    faults: Faults<'a>,
    p: Vec<f32>,
    verts: Vec<i32>,
    /// The vertices by the bits of their positions.
    known: HashMap<[u32; 3], i32>,
}

impl<'a> Welded<'a> {
    fn new(reporter: &'a Reporter, name: Arc<str>) -> Self {
        Self { faults: Faults::new(reporter, name), p: Vec::new(), verts: Vec::new(), known: HashMap::new() }
    }

    /// Adds a triangle; `at` is its line, or 0, and `number` its number in the file.
    fn add(&mut self, triangle: [[f32; 3]; 3], at: u32, number: u64) {
        if triangle.as_flattened().iter().any(|x| !x.is_finite()) {
            self.faults.error("finite", at, || {
                format!("triangle {number} has numbers that are not finite: left out")
            });
            return;
        }
        if self.p.len() / 3 > i32::MAX as usize - 3 {
            self.faults
                .error("many", at, || format!("triangle {number} and all later ones are left out: too many"));
            return;
        }
        for vertex in triangle {
            // Zero and negative zero are one place.
            let vertex = vertex.map(|x| x + 0.0);
            let next = (self.p.len() / 3) as i32;
            let index = *self.known.entry(vertex.map(f32::to_bits)).or_insert(next);
            if index == next {
                self.p.extend(vertex);
            }
            self.verts.push(index);
        }
    }

    fn binary(&mut self, stream: Box<dyn Stream>, count: u64) -> std::io::Result<()> {
        let mut stream = BufReader::with_capacity(1 << 16, stream);
        let mut bytes = [0; TRIANGLE as usize];
        for i in 0..count {
            match stream.read_exact(&mut bytes) {
                Ok(()) => {}
                Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
                    self.faults.error("end", 0, || format!("the file ends after {i} of {count} triangles"));
                    return Ok(());
                }
                Err(error) => return Err(error),
            }
            let number = |k: usize| {
                let at = 12 + 4 * k;
                f32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
            };
            self.add(std::array::from_fn(|v| std::array::from_fn(|k| number(3 * v + k))), 0, i);
        }
        Ok(())
    }

    fn text(&mut self, stream: Box<dyn Stream>) -> std::io::Result<()> {
        let mut lines = Lines::new(stream, false);
        let (mut corners, mut n, mut number, mut ended) = ([[0.0; 3]; 3], 0, 0, false);
        while let Some((line, text)) = lines.next_line()? {
            let mut words = Words(text);
            let word = words.word().unwrap_or_default().to_ascii_lowercase();
            match &word[..] {
                b"vertex" => {
                    let values = [words.float(), words.float(), words.float()];
                    let [Some(x), Some(y), Some(z)] = values else {
                        self.faults.error("vertex", line, || "a vertex has fewer than three numbers".into());
                        n = 4;
                        continue;
                    };
                    if n < 3 {
                        corners[n] = [x, y, z];
                    }
                    n += 1;
                }
                b"endloop" | b"endfacet" => {
                    if n == 3 {
                        self.add(corners, line, number);
                    } else if n > 0 {
                        self.faults.error("corners", line, || {
                            format!("triangle {number} has not three vertices: left out")
                        });
                    }
                    number += u64::from(n > 0);
                    n = 0;
                }
                b"endsolid" => ended = true,
                b"solid" => ended = false,
                b"" | b"facet" | b"outer" => {}
                other => {
                    let word = String::from_utf8_lossy(&other[..other.len().min(20)]).into_owned();
                    self.faults
                        .error("word", line, || format!("\"{word}\" is no statement of STL: left out"));
                }
            }
        }
        if n > 0 || !ended {
            let line = lines.line();
            self.faults.error("end", line, || {
                format!("the file ends after {number} triangles, without \"endsolid\"")
            });
        }
        Ok(())
    }

    fn emit(mut self, emit: &mut Emit<'_>) -> Result<(), GeneratorError> {
        if self.verts.is_empty() {
            self.faults.error("empty", 0, || "no triangles: nothing to draw".into());
            return Ok(());
        }
        let shape = ShapeDesc::Mesh {
            subdivide: false,
            nverts: vec![3; self.verts.len() / 3].into(),
            verts: std::mem::take(&mut self.verts).into(),
        };
        let params = Params(vec![positions(std::mem::take(&mut self.p))]);
        Ok(emit.shape(shape, params, 1)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trial::{flat, run};

    const TEXT: &str = "solid two triangles\n\
        facet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex 1 0 0\n  vertex 1 1 0\n endloop\nendfacet\n\
        facet normal 0 0 1\n outer loop\n  vertex 0 0 0\n  vertex 1 1 0\n  vertex -0 1e0 0\n endloop\nendfacet\n\
        endsolid two triangles\n";

    const MESH: &str = "Mesh (\"linear\", (3, 3), (0, 1, 2, 0, 2, 3), \"vertex point P\", (0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0))\n";

    fn binary(triangles: &[[f32; 9]], title: &str) -> Vec<u8> {
        let mut bytes = vec![b' '; 80];
        bytes[..title.len()].copy_from_slice(title.as_bytes());
        bytes.extend((triangles.len() as u32).to_le_bytes());
        for triangle in triangles {
            bytes.extend([0; 12]);
            bytes.extend(triangle.iter().flat_map(|x| x.to_le_bytes()));
            bytes.extend([0; 2]);
        }
        bytes
    }

    const TWO: [[f32; 9]; 2] =
        [[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0], [0.0, 0.0, -0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.0]];

    #[test]
    fn text_and_binary_data_are_one_mesh_with_shared_vertices() {
        assert_eq!(flat(&run(&Stl, TEXT).clean()), MESH);
        assert_eq!(
            flat(
                &run(&Stl, TEXT.replace('\n', "\r\n").to_uppercase().replace("SOLID TWO", "solid TWO"))
                    .clean()
            ),
            MESH
        );
        // Many programs begin binary files with the word of text files.
        for title in ["", "solid exported"] {
            assert_eq!(flat(&run(&Stl, binary(&TWO, title)).clean()), MESH);
        }
    }

    #[test]
    fn what_is_wrong_is_named_and_left_out() {
        let whole = binary(&TWO, "x");
        let trial = run(&Stl, &whole[..whole.len() - 7]);
        assert_eq!(trial.messages, ["t: error: the file ends after 1 of 2 triangles"]);
        assert!(trial.pyg.starts_with("Mesh (\"linear\", (3,), (0, 1, 2)"), "{}", trial.pyg);
        let mut infinite = TWO;
        infinite[0][4] = f32::INFINITY;
        let trial = run(&Stl, binary(&infinite, "x"));
        assert_eq!(trial.messages, ["t: error: triangle 0 has numbers that are not finite: left out"]);
        let trial = run(&Stl, TEXT.replace("vertex 1 0 0", "vertex 1 zero 0"));
        assert_eq!(trial.messages, ["t:7: error: triangle 0 has numbers that are not finite: left out"]);
        let trial = run(&Stl, TEXT.replacen("  vertex 1 0 0\n", "", 1).replace("endsolid", "end"));
        let want = [
            "t:6: error: triangle 0 has not three vertices: left out",
            "t:15: error: \"end\" is no statement of STL: left out",
            "t:16: error: the file ends after 2 triangles, without \"endsolid\"",
        ];
        assert_eq!(trial.messages, want);
        let trial = run(&Stl, binary(&[], "x"));
        assert_eq!(trial.messages, ["t: error: no triangles: nothing to draw"]);
        let error = run(&Stl, "some bytes").error.unwrap().to_string();
        assert_eq!(error, "t: 10 bytes are neither text (\"solid\") nor the header of binary data");
    }
}
