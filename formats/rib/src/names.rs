//! The names of requests.

/// The requests of the interface 3.2, and those of later versions that are supported.
pub(crate) const REQUESTS: [&str; 110] = [
    "ArchiveBegin",
    "ArchiveEnd",
    "ArchiveRecord",
    "AreaLightSource",
    "Atmosphere",
    "Attribute",
    "AttributeBegin",
    "AttributeEnd",
    "Basis",
    "Blobby",
    "Bound",
    "Clipping",
    "Color",
    "ColorSamples",
    "ConcatTransform",
    "Cone",
    "CoordSysTransform",
    "CoordinateSystem",
    "CropWindow",
    "Curves",
    "Cylinder",
    "Declare",
    "DepthOfField",
    "Detail",
    "DetailRange",
    "Disk",
    "Displacement",
    "Display",
    "Else",
    "ElseIf",
    "ErrorHandler",
    "Exposure",
    "Exterior",
    "Format",
    "FrameAspectRatio",
    "FrameBegin",
    "FrameEnd",
    "GeneralPolygon",
    "GeometricApproximation",
    "GeometricRepresentation",
    "Geometry",
    "Hider",
    "HierarchicalSubdivisionMesh",
    "Hyperboloid",
    "Identity",
    "IfBegin",
    "IfEnd",
    "Illuminate",
    "Imager",
    "ImplicitSurface",
    "Interior",
    "LightSource",
    "MakeBump",
    "MakeCubeFaceEnvironment",
    "MakeCubeFaceShadow",
    "MakeLatLongEnvironment",
    "MakeShadow",
    "MakeTexture",
    "Matte",
    "MotionBegin",
    "MotionEnd",
    "NuPatch",
    "ObjectBegin",
    "ObjectEnd",
    "ObjectInstance",
    "Opacity",
    "Option",
    "Orientation",
    "Paraboloid",
    "Patch",
    "PatchMesh",
    "Perspective",
    "PixelFilter",
    "PixelSamples",
    "PixelVariance",
    "Points",
    "PointsGeneralPolygons",
    "PointsPolygons",
    "Polygon",
    "Procedural",
    "Projection",
    "Quantize",
    "ReadArchive",
    "RelativeDetail",
    "ReverseOrientation",
    "Rotate",
    "Scale",
    "ScopedCoordinateSystem",
    "ScreenWindow",
    "ShadingInterpolation",
    "ShadingRate",
    "Shutter",
    "Sides",
    "Skew",
    "SolidBegin",
    "SolidEnd",
    "Sphere",
    "SubdivisionMesh",
    "Surface",
    "TextureCoordinates",
    "Torus",
    "Transform",
    "TransformBegin",
    "TransformEnd",
    "Translate",
    "TrimCurve",
    "Volume",
    "WorldBegin",
    "WorldEnd",
    "version",
];

/// True when a line that begins with these bytes begins with a request.
pub(crate) fn begins_request(line: &[u8]) -> bool {
    let start = line.iter().position(|b| !matches!(b, b' ' | b'\t' | b'\r')).unwrap_or(line.len());
    let line = &line[start..];
    let end = line.iter().position(|b| !b.is_ascii_alphanumeric()).unwrap_or(line.len());
    let word = std::str::from_utf8(&line[..end]).unwrap_or_default();
    let follows = line.get(end).is_none_or(|b| b.is_ascii_whitespace() || matches!(b, b'"' | b'[' | b'#'));
    follows && REQUESTS.contains(&word)
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::{Location, Reporter};

    /// A scene that makes no calls.
    struct Nothing;

    impl granita_scene::SceneSink for Nothing {
        fn call(&mut self, _: granita_scene::Call, _: &Location) -> Result<(), granita_scene::Stop> {
            Ok(())
        }
    }

    #[test]
    fn all_requests_are_known_to_the_reader() {
        let (reporter, kept) = Reporter::collecting();
        for name in REQUESTS {
            let text = format!("{name}\n");
            let source = granita_scene::GeneratorSource::bytes("t.rib", text.as_bytes());
            // Most of them lack arguments, which is another error.
            let _ = crate::generators()[0].run(&source, &mut Nothing, &reporter);
        }
        let unknown: Vec<String> = kept
            .lock()
            .iter()
            .map(ToString::to_string)
            .filter(|text| text.contains("unknown request"))
            .collect();
        assert_eq!(unknown, Vec::<String>::new());
    }

    #[test]
    fn request_names_are_sorted_and_recognised() {
        assert!(REQUESTS.windows(2).all(|w| w[0] < w[1]));
        for good in ["  Sphere 1", "WorldEnd", "WorldEnd\n", "\tColor[1 1 1]", "Surface\"a\""] {
            assert!(begins_request(good.as_bytes()), "{good}");
        }
        for bad in ["", "sphere 1", "Spheres of", "Sphere, a", "3", "\"Sphere"] {
            assert!(!begins_request(bad.as_bytes()), "{bad}");
        }
    }
}
