//! A scene of fur: curves all over a sphere, swaying while the shutter is open, before a lens.

use std::fmt::Write;

/// The properties of the scene that cost extra.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fur {
    /// The number of curves.
    pub curves: usize,
    /// The number of samples across and down a pixel.
    pub spatialquality: u32,
    /// True when the curves move.
    pub moves: bool,
    /// True when there is depth of field.
    pub defocus: bool,
    /// True when the frame is rendered for two eyes.
    pub stereo: bool,
}

impl Default for Fur {
    fn default() -> Self {
        Self { curves: 20_000, spatialquality: 4, moves: true, defocus: true, stereo: false }
    }
}

/// A generator of random numbers between 0 and 1. The sequence is always the same.
struct Random(u32);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(self.0 >> 8) / f64::from(1 << 24)
    }
}

impl Fur {
    /// Returns the scene, which renders 640 x 480 pixels into `out.tif`.
    pub fn scene(&self) -> String {
        let q = self.spatialquality;
        let mut text = format!(
            "Attribute (\"int[2] resolution\", (640, 480))\nAttribute (\"int[2] spatialquality\", ({q}, {q}))\n\
             Attribute (\"string projection\", \"perspective\")\nAttribute (\"float fov\", 34)\n"
        );
        if self.moves {
            text += "Attribute (\"float[2] shutter\", (0, 1))\n";
        }
        if self.defocus {
            text += "Attribute (\"float fstop\", 2.8)\nAttribute (\"float focallength\", 0.12)\n\
                     Attribute (\"float focaldistance\", 3.9)\n";
        }
        if self.stereo {
            text += "Attribute (\"float stereo:separation\", 0.15)\n\
                     Attribute (\"float stereo:convergence\", 4.5)\n";
        }
        text += "Translate (0, 0, 5)\nRotate (20, 1, 0, 0)\nOutput (\"out.tif\", \"tiff\", \"rgba\", \"camera\")\n\
                 World ()\nLight (\"amb\", \"ambientlight\", \"float intensity\", 0.1)\n\
                 Light (\"key\", \"distantlight\", \"float intensity\", 0.9, \"point from\", (-1, 2, -1.5), \
                 \"point to\", (0, 0, 0))\n\
                 Light (\"rim\", \"distantlight\", \"float intensity\", 0.7, \"point from\", (2, 1, 1.5), \
                 \"point to\", (0, 0, 0))\n\
                 Shader (\"surface\", \"plastic\")\nAttribute (\"color C\", (0.12, 0.07, 0.04))\n\
                 Sphere (1, -1, 1, 360)\nAttribute (\"color C\", (0.55, 0.33, 0.16))\n";
        if self.moves {
            text += "Motion (0, 1)\n";
        }
        let widths = vec!["0.012, 0.003"; self.curves].join(", ");
        for sway in [0.0, 0.06].into_iter().take(1 + usize::from(self.moves)) {
            let _ = write!(text, "Curves (\"bezier\", {}, 4, \"vertex point P\", (", self.curves);
            self.points(sway, &mut text);
            let _ = writeln!(text, "), \"linear float width\", ({widths}))");
        }
        text += "Render ()\n";
        text
    }

    /// Writes the points of the curves. The roots are spread evenly over the sphere. The tips droop and are moved aside
    /// by `sway`.
    fn points(&self, sway: f64, text: &mut String) {
        let mut random = Random(1);
        for i in 0..self.curves {
            let z = 1.0 - 2.0 * (i as f64 + 0.5) / self.curves as f64;
            let (r, turn) = ((1.0 - z * z).sqrt(), i as f64 * 2.399_963);
            let root = [r * turn.cos(), r * turn.sin(), z];
            let length = 0.3 + 0.1 * random.next();
            let bend = [0.0, -0.6, 0.0].map(|droop| (droop + random.next() * 0.7 - 0.35) * length);
            for k in 0..4 {
                let t = f64::from(k) / 3.0;
                let [x, y, z]: [f64; 3] =
                    std::array::from_fn(|c| root[c] * (1.0 + length * t) + bend[c] * t * t);
                let comma = if i == 0 && k == 0 { "" } else { ", " };
                let _ = write!(text, "{comma}{:.4}, {y:.4}, {z:.4}", x + sway * t * t);
            }
        }
    }
}
