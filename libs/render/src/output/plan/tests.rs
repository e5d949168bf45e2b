//! Tests of the plans of images.

use super::*;
use granita_base::Filter;
use granita_image::Limits;

fn camera() -> CameraView {
    let camera = granita_scene::Camera {
        name: "main".into(),
        world_to_camera: Default::default(),
        params: Params(vec![
            Param::declared("int[2] resolution", &[8, 6][..]).unwrap(),
            Param::declared("float[4] crop", &[0.25_f32, 1.0, 0.5, 1.0][..]).unwrap(),
        ]),
    };
    CameraView::new(&camera, &Reporter::silent())
}

fn output(name: &str, format: &str, data: &str, params: &[Param]) -> Output {
    Output {
        name: name.into(),
        format: format.into(),
        data: data.into(),
        camera: "main".into(),
        params: Params(params.to_vec()),
    }
}

#[test]
fn outputs_share_the_variables_that_they_request() {
    let registry = granita_plugin::bundled_formats(Limits::default());
    let (reporter, kept) = Reporter::collecting();
    let outputs = [
        output("a", "tiff", "rgba", &[]),
        output("b", "tiff", "z", &[]),
        output("c", "tiff", "normal N", &[]),
        output("d", "tiff", "float Kd", &[]),
        output("e", "tiff", "normal N", &[]),
        output("f", "null", "rgb", &[]),
        output("g", "nosuch", "rgb", &[]),
        output("h", "tiff", "volz", &[]),
        output("i", "tiff", "string name", &[]),
    ];
    let list: Vec<&Output> = outputs.iter().collect();
    let set = OutputSet::new(&list, &camera(), &registry, &reporter).unwrap();
    let channels: Vec<&[usize]> = set.images.iter().map(|i| &i.layers[0].channels[..]).collect();
    assert_eq!(channels, [&[0, 1, 2, 3][..], &[4], &[6, 7, 8], &[9], &[6, 7, 8], &[0; 5]]);
    assert_eq!((set.images[5].opaque_width, set.images[4].opaque_width), (Some(0.05), None));
    assert_eq!(set.images[5].names, ["zopaque", "alpha", "z0", "z1", "z2"]);
    let kinds = [5, 1].map(|k: usize| {
        let spec = set.images[k].spec(&camera(), PixelType::Float);
        granita_texture::TextureKind::of(&spec)
    });
    assert_eq!(kinds, [granita_texture::TextureKind::VolumeShadow, granita_texture::TextureKind::Shadow]);
    assert_eq!((set.variables.len(), set.wanted.channels()), (2, 10));
    assert!(set.needs_shading && !set.needs_second_surface);
    assert_eq!(kept.lock().len(), 2);
    let only_depth = OutputSet::new(&list[1..2], &camera(), &registry, &reporter).unwrap();
    assert!(!only_depth.needs_shading);
    assert_eq!(
        only_depth.images[0].layers[0].filter,
        FilterSpec { filter: PixelFilter::Min, width: [1.0; 2] }
    );
}

#[test]
fn arrays_become_channels() {
    let registry = granita_plugin::bundled_formats(Limits::default());
    let (reporter, kept) = Reporter::collecting();
    let outputs = [
        output("a", "exr", "float[3] weights", &[]),
        output("b", "exr", "color[2] layers", &[]),
        output("c", "exr", "float[2000] many", &[]),
    ];
    let list: Vec<&Output> = outputs.iter().collect();
    let set = OutputSet::new(&list, &camera(), &registry, &reporter).unwrap();
    assert_eq!(set.images[0].names, ["weights[0]", "weights[1]", "weights[2]"]);
    assert_eq!(set.images[1].names[2..4], ["layers[0].B", "layers[1].R"]);
    let layers: Vec<&ImageLayer> = set.images.iter().map(|image| &image.layers[0]).collect();
    assert_eq!((layers[0].channels.clone(), layers[1].channels.len()), (vec![4, 5, 6], 6));
    assert!(layers[1].is_color && !layers[0].is_color);
    let said = kept.lock();
    assert!(said.len() == 1 && said[0].text.contains("2000 elements, 1 to 1024"), "{said:?}");
}

#[test]
fn several_data_become_layers_with_filters_of_their_kinds() {
    let registry = granita_plugin::bundled_formats(Limits::default());
    let (reporter, kept) = Reporter::collecting();
    let data = "rgba, z, color diffuse, normal N, point P, float id";
    let params = [
        Param::declared("string filter", "box").unwrap(),
        Param::declared("float[2] filterwidth", &[1.0_f32, 1.0][..]).unwrap(),
        Param::declared("string filter:id", "closest").unwrap(),
    ];
    let output = output("a", "exr", data, &params);
    let set = OutputSet::new(&[&output], &camera(), &registry, &reporter).unwrap();
    let image = &set.images[0];
    assert_eq!(image.names.join(" "), "R G B A Z diffuse.R diffuse.G diffuse.B N.X N.Y N.Z P.X P.Y P.Z id");
    let filters: Vec<PixelFilter> = image.layers.iter().map(|layer| layer.filter.filter).collect();
    let boxes = PixelFilter::Weighted(Filter::Box);
    let (min, closest) = (PixelFilter::Min, PixelFilter::Closest);
    assert_eq!(filters, [boxes, min, boxes, boxes, closest, closest]);
    let channels: Vec<usize> = image.layers.iter().flat_map(|layer| layer.channels.clone()).collect();
    assert_eq!(channels, [0, 1, 2, 3, 4, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15]);
    let colors: Vec<usize> = (0..15).filter(|c| image.colors()[*c]).collect();
    assert_eq!(colors, [0, 1, 2, 5, 6, 7]);
    let mut pixel: Vec<f32> = (0..15).map(|v| v as f32).collect();
    image.tint(&mut pixel, Color::new(2.0, 2.0, 2.0));
    assert_eq!(pixel[..9], [0.0, 2.0, 4.0, 3.0, 4.0, 10.0, 12.0, 14.0, 8.0]);
    let joined = image.interleaved(
        image
            .layers
            .iter()
            .map(|l| l.channels.iter().chain(&l.channels).map(|c| *c as f32).collect())
            .collect(),
    );
    assert_eq!(joined[..15], joined[15..]);
    assert_eq!(joined[..6], [0.0, 1.0, 2.0, 3.0, 4.0, 6.0]);
    assert_eq!(kept.lock().len(), 0, "{:?}", kept.lock());
}

#[test]
fn layers_that_do_not_fit_are_refused() {
    let registry = granita_plugin::bundled_formats(Limits::default());
    let refused = |format: &str, data: &str, params: &[Param]| {
        let (reporter, kept) = Reporter::collecting();
        OutputSet::new(&[&output("a", format, data, params)], &camera(), &registry, &reporter).unwrap();
        kept.lock().iter().map(|m| m.text.clone()).collect::<Vec<_>>().join("; ")
    };
    let closest = |name: &str| [Param::declared(&format!("string filter:{name}"), "closest").unwrap()];
    let cases = [
        (refused("tiff", "rgb,z", &[]), "format \"tiff\" does not store several layers; \"exr\" does"),
        (refused("exr", "rgb,rgba", &[]), "data \"rgb,rgba\": two layers have the channel \"R\""),
        (refused("exr", "rgb,float R", &[]), "data \"rgb,float R\": two layers have the channel \"R\""),
        (
            refused("exr", "rgb,z", &[Param::declared("string filter:z", "bell").unwrap()]),
            "\"filter:z\" is one of gaussian, box, triangle, catmull-rom, sinc, blackman-harris, mitchell, b-spline, min, \
             max, average, closest; the filter of its kind is used",
        ),
        (refused("exr", "rgb,", &[]), "data \"rgb,\": a layer has no name"),
        (refused("exr", "rgb,volz", &[]), "\"volz\" cannot be one of several layers"),
        (refused("exr", "rgb,z", &closest("P")), "\"filter:P\": no layer has this name (there are: rgb, z)"),
        (
            refused("exr", "rgb", &closest("rgb")),
            "\"filter:rgb\" is for one of several layers; \"filter\" is for all",
        ),
    ];
    for (said, expected) in cases {
        assert_eq!(said, format!("output \"a\": {expected}"));
    }
}

#[test]
fn misspelled_parameters_are_reported_with_a_suggestion() {
    let registry = granita_plugin::bundled_formats(Limits::default());
    let (reporter, kept) = Reporter::collecting();
    let param = |declaration: &str| Param::declared(declaration, 2.0).unwrap();
    let params =
        [param("float gama"), param("float compresion"), param("float studio:mood"), param("float gain")];
    let output = output("a", "tiff", "rgb", &params);
    OutputSet::new(&[&output], &camera(), &registry, &reporter).unwrap();
    let said: Vec<String> = kept.lock().iter().map(|m| m.text.clone()).collect();
    assert_eq!(
        said,
        [
            "output \"a\": there is no parameter \"gama\"; did you mean \"gamma\"?",
            "output \"a\": there is no parameter \"compresion\"; did you mean \"compression\"?",
        ]
    );
}

#[test]
fn two_names_of_one_output_file_are_recognised() {
    let registry = granita_plugin::bundled_formats(Limits::default());
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let outputs =
        [at("a.tif"), at("./a.tif"), at("b.tif"), at("../b.tif")].map(|n| output(&n, "tiff", "rgb", &[]));
    let list: Vec<&Output> = outputs.iter().collect();
    let set = OutputSet::new(&list, &camera(), &registry, &Reporter::silent()).unwrap();
    let mut files = WrittenFiles::default();
    // The names differ as text only.
    let names: Vec<String> = outputs.iter().map(|o| o.name.to_string()).collect();
    assert_ne!(names[0], names[1]);
    let taken: Vec<bool> = set.images.iter().map(|image| files.taken_by(image).is_some()).collect();
    assert_eq!(taken, [false, true, false, false]);
    let image = OutputImage { path: folder.path().join("x/../a.tif"), ..set.images[0].clone() };
    std::fs::create_dir(folder.path().join("x")).unwrap();
    assert_eq!(files.taken_by(&image).as_deref(), Some(&*set.images[0].path));
    assert!(files.taken_by(&set.images[0]).is_none());
}

#[test]
fn files_store_the_crop_window_and_the_parameters() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tif");
    let registry = granita_plugin::bundled_formats(Limits::default());
    let params = [
        Param::declared("int[4] quantize", &[0, 0, 0, 0][..]).unwrap(),
        Param::declared("float gain", 2.0).unwrap(),
        Param::declared("string Artist", "somebody").unwrap(),
    ];
    let output = output(path.to_str().unwrap(), "tiff", "rgba", &params);
    let camera = camera();
    let mut set = OutputSet::new(&[&output], &camera, &registry, &Reporter::silent()).unwrap();
    let image = &mut set.images[0];
    image.pixels = vec![0.0; 6 * 3 * 4];
    image.pixels[(6 + 2) * 4..][..8].copy_from_slice(&[0.1, 0.2, 0.3, 0.5, 0.4, 0.4, 0.4, 1.0]);
    image.write(&camera, &registry).unwrap();
    let file = registry.open(&path).unwrap();
    let spec = file.spec(0, 0).unwrap();
    assert_eq!((spec.width, spec.height, spec.x, spec.y), (6, 3, 2, 3));
    assert_eq!((spec.full_width, spec.full_height), (8, 6));
    assert_eq!(spec.string("Artist"), Some("somebody"));
    let values = file.read_level(0, 0).unwrap().to_floats();
    let at = (6 + 2) * 4;
    // Gain is for colours, not for alpha.
    assert_eq!(values[at..at + 8], [0.2, 0.4, 0.6, 0.5, 0.8, 0.8, 0.8, 1.0]);
}

#[test]
fn parts_have_the_filters_of_their_kinds() {
    let registry = granita_plugin::bundled_formats(Limits::default());
    let part = |name: &str| Param::declared("string part", name).unwrap();
    let filter = |word: &str| Param::declared("string filter", word).unwrap();
    let outputs = [
        output("a.exr", "exr", "point P", &[part("position")]),
        output("a.exr", "exr", "point P", &[part("blurred"), filter("box")]),
        output("b.exr", "exr", "point P", &[]),
        output("a.exr", "exr", "float object_id", &[part("ids")]),
        output("a.exr", "exr", "float solid", &[part("solid")]),
        output("a.exr", "exr", "z", &[part("depth")]),
        output("a.exr", "exr", "rgb", &[part("depth")]),
    ];
    let list: Vec<&Output> = outputs.iter().collect();
    let (reporter, kept) = Reporter::collecting();
    let set = OutputSet::new(&list, &camera(), &registry, &reporter).unwrap();
    let filters: Vec<PixelFilter> = set.images.iter().map(|image| image.layers[0].filter.filter).collect();
    let (closest, weighted) = (PixelFilter::Closest, PixelFilter::Weighted);
    let gaussian = weighted(Filter::Gaussian);
    assert_eq!(filters, [closest, weighted(Filter::Box), gaussian, closest, gaussian, PixelFilter::Min]);
    let said: Vec<String> = kept.lock().iter().map(ToString::to_string).collect();
    assert!(said.len() == 1 && said[0].contains("two images are the part \"depth\""), "{said:?}");
    assert_eq!(set.images[0].path_alone(), Path::new("a.position.exr"));
}
