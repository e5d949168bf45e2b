//! Tests that a frame rendered by several processes (`-net`) has the same pixels as one rendered by a single process,
//! even when workers fail.

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use granita_tests::{Image, Tools, copy_first, repository};
use std::path::Path;

/// A replacement for ssh. The host "there" is this machine, and "cut" closes the connection in the middle of a bucket.
/// No other host exists.
const SSH: &str = "shift 5
case $1 in
    there) exec /bin/sh -c \"$2\" ;;
    cut) /bin/sh -c \"$2\" | dd bs=1 count=30000 2>/dev/null ;;
    *) echo \"no route to $1\" >&2; exit 255 ;;
esac";

/// Renders the example. Returns its image and the messages.
fn render(tools: &Tools, place: &Path, servers: &[&str]) -> (Image, String) {
    let out = place.join("examples/first/out");
    if out.exists() {
        std::fs::remove_dir_all(&out).unwrap();
    }
    let path = format!("PATH={}:{}", place.display(), std::env::var("PATH").unwrap());
    let mut words = vec!["-env", &path];
    servers.iter().for_each(|server| words.extend(["-net", server]));
    words.extend(["command.pyg", "examples/first/first.pyg", "-o", "out.exr"]);
    let ran = tools.run(place, "gelato", &words).unwrap();
    assert_eq!(ran.status, 0, "{servers:?}: {}", ran.stderr);
    let file = place.join("out.exr");
    let image = Image::read(&file).unwrap();
    std::fs::remove_file(file).unwrap();
    (image, ran.stderr)
}

#[test]
fn frames_of_several_processes_equal_those_of_one() {
    let tools = Tools::build().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    copy_first(place).unwrap();
    granita_needs::write_script(&place.join("ssh"), SSH);
    let gelato = tools.program("gelato");
    let command = format!("Attribute (\"string net:workercmd\", \"{}\")\n", gelato.display());
    std::fs::write(place.join("command.pyg"), command).unwrap();
    let (alone, said) = render(&tools, place, &[]);
    assert!(alone.is_varied() && said.is_empty(), "{said}");
    for (servers, told) in [
        (&["local there"][..], None),
        (&["cut", "local"], Some("-net: the worker on cut is gone")),
        (&["nowhere"], Some("-net: the worker on nowhere is gone: it did not start")),
    ] {
        let (image, said) = render(&tools, place, servers);
        assert!(image == alone, "{servers:?}: other pixels");
        match told {
            None => assert!(said.is_empty(), "{said}"),
            Some(text) => assert!(said.contains(text), "{said}"),
        }
    }
}

#[test]
fn databases_saved_by_workers_are_complete() {
    let tools = Tools::build().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    for file in ["bake.gsl", "bake.pyg", "few.pyg"] {
        std::fs::copy(repository().join("tests/suite/database/bake").join(file), place.join(file)).unwrap();
    }
    assert_eq!(tools.run(place, "gslc", &["bake.gsl"]).unwrap().status, 0);
    let bake = |words: &[&str]| {
        let ran = tools.run(place, "gelato", &[words, &["few.pyg", "bake.pyg"]].concat()).unwrap();
        assert!(ran.status == 0 && ran.stderr.is_empty(), "{}", ran.stderr);
        let bytes = std::fs::read(place.join("ramp.sdb")).unwrap();
        std::fs::remove_file(place.join("ramp.sdb")).unwrap();
        bytes
    };
    assert!(bake(&[]) == bake(&["-net", "local local"]), "another database");
}

/// Workers that delay a frame: the text of a shell script, and a part of the expected message.
const STUCK: [(&str, &str); 6] = [
    // The worker sends nothing.
    ("exec sleep 1000", "it has been silent for 5 s"),
    // The worker is stopped before it sends its first line.
    ("kill -STOP $$", "it has been silent for 5 s"),
    // The worker is stopped in the middle of an answer.
    (
        "$GELATO \"$@\" | { dd bs=1 count=30000 2>/dev/null; kill -STOP $$; sleep 1000; }",
        "it has been silent for 5 s",
    ),
    // The worker has another version.
    (
        "echo granita-worker 0.0.1 2; exec sleep 1000",
        "it is \"granita-worker 0.0.1 2\", and this is \"granita-worker",
    ),
    // The worker announces four billion bytes, and sends none.
    (
        "$GELATO \"$@\" | head -c 25; printf 'P\\377\\377\\377\\377'; exec sleep 1000",
        "its answer has 4294967295 bytes",
    ),
    // The worker announces more images than there are.
    (
        "$GELATO \"$@\" | head -c 25; printf 'P\\020\\000\\000\\000\\000\\000\\000\\000\\000\\000\\000\\000\\000\\000\\000\\000\\376\\377\\377\\377'; exec sleep 1000",
        "its answer is malformed",
    ),
];

#[test]
fn hanging_workers_do_not_block_a_frame() {
    let tools = Tools::build().unwrap();
    let whole = tempfile::tempdir().unwrap();
    copy_first(whole.path()).unwrap();
    std::fs::write(whole.path().join("command.pyg"), "").unwrap();
    let begin = std::time::Instant::now();
    let (alone, _) = render(&tools, whole.path(), &[]);
    // All frames are rendered at once, some buckets twice, on machines that do other work as well.
    let most = std::time::Duration::from_secs(20) + 4 * STUCK.len() as u32 * begin.elapsed();
    std::thread::scope(|scope| {
        for (script, told) in STUCK {
            let (tools, alone) = (&tools, &alone);
            scope.spawn(move || {
                let folder = tempfile::tempdir().unwrap();
                let place = folder.path();
                copy_first(place).unwrap();
                let fake = place.join("fake");
                let gelato = tools.program("gelato");
                granita_needs::write_script(&fake, &format!("GELATO='{}'\n{script}", gelato.display()));
                let command = format!(
                    "Attribute (\"string net:workercmd\", \"{}\")\nAttribute (\"float net:timeout\", 5)\n",
                    fake.display()
                );
                std::fs::write(place.join("command.pyg"), command).unwrap();
                let begin = std::time::Instant::now();
                let (image, said) = render(tools, place, &["local"]);
                assert!(begin.elapsed() < most, "{script}: {:?} of {most:?}", begin.elapsed());
                assert!(image == *alone, "{script}: other pixels");
                assert!(
                    said.contains("-net: the worker on local is gone: ") && said.contains(told),
                    "{script}: {said}"
                );
            });
        }
    });
}

/// "net:workers" distributes frames without options on the command line. With "net:tint" each worker has a colour.
#[test]
fn workers_named_by_an_attribute_tint_their_buckets() {
    let tools = Tools::build().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    let gelato = tools.program("gelato");
    let render = |attributes: &str| {
        let scene = format!(
            "{attributes}Attribute (\"int[2] resolution\", (48, 16))\nAttribute (\"int[2] limits:bucketsize\", (16, 16))\n\
             Output (\"out.tif\", \"tiff\", \"rgba\", \"camera\", \"int[4] quantize\", (0, 0, 0, 0))\nTranslate (0, 0, 1)\n\
             World ()\nShader (\"surface\", \"constant\")\nSphere (9, -9, 9, 360)\nRender ()\n"
        );
        std::fs::write(place.join("scene.pyg"), scene).unwrap();
        let ran = tools.run(place, "gelato", &["scene.pyg"]).unwrap();
        assert!(ran.status == 0 && ran.stderr.is_empty(), "{}", ran.stderr);
        Image::read(&place.join("out.tif")).unwrap()
    };
    let workers = |list: &str| {
        format!(
            "Attribute (\"string net:workercmd\", \"{}\")\nAttribute (\"string net:workers\", \"{list}\")\n",
            gelato.display()
        )
    };
    let alone = render("");
    assert_eq!(alone.pixel(20, 8).unwrap(), [1.0; 4]);
    assert!(render(&workers("local local")) == alone);
    let tint = |seed: u32| format!("Attribute (\"int net:tint\", {seed})\n");
    // Without workers there is no tint.
    assert!(render(&tint(1)) == alone);
    let (one, other) = (render(&(workers("local") + &tint(1))), render(&(workers("local") + &tint(2))));
    for image in [&one, &other] {
        let color = image.pixel(20, 8).unwrap();
        assert!(color[..3] != [1.0; 3] && color[3] == 1.0, "{color:?}");
        // One worker renders all buckets, which have one colour.
        assert!((0..48).all(|x| image.pixel(x, 8).unwrap() == color));
    }
    assert!(one != other, "the seed chooses the colours");
}

/// Names of objects that only one worker sees are in the manifest as well.
#[test]
fn cryptomattes_of_workers_equal_those_of_one_process() {
    let tools = Tools::build().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    let gelato = tools.program("gelato");
    let spheres: String = (0..6)
        .map(|i| {
            format!(
                "PushTransform ()\nTranslate ({}, 0, 0)\nAttribute (\"string name\", \"ball{i}\")\nSphere (0.4, -0.4, 0.4, 360)\nPopTransform ()\n",
                i as f32 - 2.5
            )
        })
        .collect();
    let scene = format!(
        "Attribute (\"string net:workercmd\", \"{}\")\nAttribute (\"int[2] resolution\", (96, 32))\nAttribute (\"int[2] limits:bucketsize\", (16, 16))\n\
         Attribute (\"float[4] screen\", (-3, 3, -1, 1))\nOutput (\"out.exr\", \"exr\", \"cryptomatte object\", \"camera\")\n\
         Translate (0, 0, 3)\nWorld ()\nShader (\"surface\", \"constant\")\n{spheres}Render ()\n",
        gelato.display()
    );
    std::fs::write(place.join("scene.pyg"), scene).unwrap();
    let render = |words: &[&str]| {
        let ran = tools.run(place, "gelato", &[words, &["scene.pyg"]].concat()).unwrap();
        assert!(ran.status == 0 && ran.stderr.is_empty(), "{}", ran.stderr);
        std::fs::read(place.join("out.exr")).unwrap()
    };
    let alone = render(&[]);
    let holds = |word: &[u8]| alone.windows(word.len()).any(|part| part == word);
    assert!((0..6).all(|i| holds(format!("ball{i}").as_bytes())), "a name is missing");
    assert!(render(&["-net", "local local"]) == alone, "another file");
}

/// Workers leave out the same images as the process that asks them.
#[test]
fn images_that_are_left_out_cost_no_worker() {
    let tools = Tools::build().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    let scene = format!(
        "Attribute (\"string net:workercmd\", \"{}\")\nAttribute (\"int[2] resolution\", (64, 32))\nAttribute (\"int[2] limits:bucketsize\", (16, 16))\n\
         Output (\"noise.exr\", \"exr\", \"error\", \"camera\")\nOutput (\"out.exr\", \"exr\", \"rgba\", \"camera\")\n\
         Translate (0, 0, 3)\nWorld ()\nShader (\"surface\", \"constant\")\nSphere (1, -1, 1, 360)\nRender ()\n",
        tools.program("gelato").display()
    );
    std::fs::write(place.join("scene.pyg"), scene).unwrap();
    let render = |words: &[&str]| {
        let ran = tools.run(place, "gelato", &[words, &["scene.pyg"]].concat()).unwrap();
        assert!(ran.status == 1 && ran.stderr.lines().count() == 1, "{}", ran.stderr);
        assert!(ran.stderr.contains("\"noise.exr\": it is left out"), "{}", ran.stderr);
        std::fs::read(place.join("out.exr")).unwrap()
    };
    assert!(render(&[]) == render(&["-net", "local local"]));
}
