//! Tests of database files and of sessions with them.
#![allow(clippy::unwrap_used, reason = "tests")]

use granita_base::{Environment, Reporter, SearchPath, hash};
use granita_image::Limits;
use granita_sdb::{
    Attributes, Between, Databases, ImageOptions, Key, Mode, Probe, Schema, SdbError, Value, read,
};
use proptest::prelude::*;
use std::path::Path;

const POINTS: Schema = Schema { key: Key::Point, value: Value::Color };

fn unit(i: u32, k: u32) -> f32 {
    hash::unit(hash::words(&[i, k]))
}

fn path(folder: &Path) -> SearchPath {
    SearchPath::parse(&folder.to_string_lossy(), &SearchPath::default(), &Environment::empty())
}

fn databases() -> (Databases, impl Fn() -> Vec<String>) {
    let (reporter, messages) = Reporter::collecting();
    let formats = granita_plugin::bundled_formats(Limits::default());
    let texts = move || messages.lock().iter().map(ToString::to_string).collect();
    (Databases::new(formats, reporter), texts)
}

fn records(count: u32) -> Vec<f32> {
    (0..count).flat_map(|i| (0..6).map(move |k| unit(i, k))).collect()
}

fn mode(word: &str) -> Mode {
    Mode::from_word(word).unwrap()
}

/// Returns the name of a file in a folder.
fn name(folder: &tempfile::TempDir, file: &str) -> String {
    folder.path().join(file).to_string_lossy().into_owned()
}

#[test]
fn files_do_not_depend_on_the_order_of_records_or_the_memory() {
    let folder = tempfile::tempdir().unwrap();
    let all = records(5000);
    let mut bytes: Vec<Vec<u8>> = Vec::new();
    for (round, memory) in [usize::MAX, 6 * 100, 6 * 1001, 0].into_iter().enumerate() {
        let (databases, _) = databases();
        let databases = databases.with_memory(memory);
        let file = name(&folder, &format!("{round}.sdb"));
        let mut pieces: Vec<&[f32]> = all.chunks(6 * 7).collect();
        pieces.sort_by_key(|p| hash::words(&[p[0].to_bits(), round as u32]));
        // Records are added from two threads.
        let (a, b) = pieces.split_at(pieces.len() / 2);
        std::thread::scope(|scope| {
            for half in [a, b] {
                let (databases, file) = (&databases, &file);
                scope.spawn(move || {
                    for piece in half {
                        databases.save(file, POINTS, mode("wo"), None, piece);
                    }
                });
            }
        });
        let finished = databases.finish(&path(folder.path())).unwrap();
        assert_eq!((finished.records, finished.written.len()), (5000, 1));
        bytes.push(std::fs::read(&file).unwrap());
    }
    assert!(bytes.windows(2).all(|pair| pair[0] == pair[1]));
    let packed = read(&folder.path().join("0.sdb")).unwrap();
    assert_eq!((packed.len(), packed.schema()), (5000, POINTS));
    let sorted = |numbers: &[f32]| {
        let mut list: Vec<[u32; 6]> =
            numbers.chunks(6).map(|r| std::array::from_fn(|i| r[i].to_bits())).collect();
        list.sort_unstable();
        list
    };
    assert_eq!(sorted(packed.records()), sorted(&all));
    // The folder contains nothing else.
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 4);
}

#[test]
fn damaged_files_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let file = name(&folder, "a.sdb");
    let (databases, _) = databases();
    databases.save(&file, POINTS, mode("w"), None, &records(40));
    databases.finish(&path(folder.path())).unwrap();
    let whole = std::fs::read(&file).unwrap();
    let broken = folder.path().join("b.sdb");
    let refused = |bytes: &[u8]| {
        std::fs::write(&broken, bytes).unwrap();
        let error = read(&broken).unwrap_err();
        assert!(error.to_string().contains("b.sdb: "), "{error}");
        error
    };
    for cut in [0, 1, 8, 127, 128, 129, whole.len() - 4, whole.len() - 1] {
        assert!(matches!(refused(&whole[..cut]), SdbError::Malformed { .. }), "cut to {cut}");
    }
    let longer = [&whole[..], &[0; 4]].concat();
    assert!(refused(&longer).to_string().contains("bytes of records where"));
    for at in (0..whole.len()).step_by(3) {
        let mut altered = whole.clone();
        altered[at] ^= 0x10;
        let error = refused(&altered);
        assert!(matches!(error, SdbError::Malformed { .. }) || (8..12).contains(&at), "byte {at}: {error}");
    }
    assert!(
        refused(
            b"II*\0 this is some other kind of file, and long enough to have a header: so it is looked at; \
        more words follow until there are enough of them"
        )
        .to_string()
        .contains("not a spatial database")
    );
    assert!(matches!(read(folder.path()), Err(SdbError::Malformed { .. } | SdbError::Io { .. })));
    assert!(matches!(read(&folder.path().join("none.sdb")), Err(SdbError::Io { .. })));
    // A session continues without it, with one message.
    std::fs::write(&broken, &whole[..500]).unwrap();
    let (databases, texts) = self::databases();
    for _ in 0..3 {
        assert!(databases.records("b.sdb", mode("r"), &path(folder.path())).is_none());
        assert!(databases.records("none.sdb", mode("r"), &path(folder.path())).is_none());
    }
    assert_eq!(texts().len(), 2, "{:?}", texts());
    assert!(texts()[0].contains("b.sdb") && texts()[1].contains("\"none.sdb\" not found"), "{:?}", texts());
}

#[test]
fn a_failed_write_keeps_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let file = name(&folder, "no/such/folder.sdb");
    let (databases, _) = databases();
    databases.save(&file, POINTS, mode("w"), None, &records(3));
    let other = name(&folder, "other.sdb");
    databases.save(&other, POINTS, mode("w"), None, &records(3));
    let errors = databases.finish(&path(folder.path())).unwrap_err();
    assert!(errors.len() == 1 && errors[0].to_string().contains("folder.sdb"), "{errors:?}");
    assert_eq!(read(Path::new(&other)).unwrap().len(), 3, "the others are written all the same");
    #[cfg(target_os = "linux")]
    {
        let (databases, _) = self::databases();
        databases.save("/dev/full", POINTS, mode("w"), None, &records(5000));
        let error = databases.finish(&path(folder.path())).unwrap_err()[0].to_string();
        assert!(error.starts_with("/dev/full: "), "{error}");
    }
}

/// The variable that names the folder of a process of this test whose files cannot grow.
const FOLDER: &str = "GRANITA_TEST_OF_A_FULL_DISK";

/// Files that cannot grow simulate a full disk. Each database is named, and the previous files stay.
#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_keeps_the_old_files() {
    if let Some(folder) = std::env::var_os(FOLDER) {
        return on_a_full_disk(Path::new(&folder));
    }
    let folder = tempfile::tempdir().unwrap();
    let (databases, _) = databases();
    for file in ["a.sdb", "b.sdb", "small.sdb"] {
        databases.save(&name(&folder, file), POINTS, mode("w"), None, &records(20));
    }
    databases.finish(&path(folder.path())).unwrap();
    let bytes = |file: &str| std::fs::read(folder.path().join(file)).unwrap();
    let before = ["a.sdb", "b.sdb", "small.sdb"].map(bytes);
    // When the signal is ignored, the write returns an error instead.
    let limited =
        "trap '' XFSZ; ulimit -f 32; exec \"$0\" --exact a_full_disk_keeps_the_old_files --nocapture";
    let ran = std::process::Command::new("sh")
        .args(["-c", limited])
        .arg(std::env::current_exe().unwrap())
        .env(FOLDER, folder.path())
        .output()
        .unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    assert_eq!(["a.sdb", "b.sdb"].map(bytes), before[..2]);
    assert_ne!(bytes("small.sdb"), before[2]);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 3, "nothing half written stays");
}

#[cfg(target_os = "linux")]
fn on_a_full_disk(folder: &Path) {
    let at = |file: &str| folder.join(file).to_string_lossy().into_owned();
    // One database is too large at the end, and one already while its records are stored in a temporary file.
    let (databases, texts) = databases();
    let databases = databases.with_memory(4096);
    databases.save(&at("a.sdb"), POINTS, mode("w"), None, &records(680));
    databases.save(&at("b.sdb"), POINTS, mode("w"), None, &records(5000));
    databases.save(&at("b.sdb"), POINTS, mode("w"), None, &records(3));
    databases.save(&at("small.sdb"), POINTS, mode("w"), None, &records(3));
    assert!(texts().len() == 1 && texts()[0].contains("b.sdb"), "{:?}", texts());
    let errors = databases.finish(&path(folder)).unwrap_err();
    let said: Vec<String> = errors.iter().map(ToString::to_string).collect();
    assert!(said.len() == 2 && said[0].contains("a.sdb") && said[1].contains("b.sdb"), "{said:?}");
    assert!(said[1].contains("records are missing"), "{said:?}");
    // The next frame begins with empty databases.
    databases.save(&at("b.sdb"), POINTS, mode("wo"), None, &[]);
    databases.begin();
    assert!(databases.finish(&path(folder)).unwrap().written.is_empty());
}

#[test]
fn modes_choose_which_records_are_read_and_kept() {
    let folder = tempfile::tempdir().unwrap();
    let file = name(&folder, "m.sdb");
    let count = |databases: &Databases, word: &str| {
        databases.records(&file, mode(word), &path(folder.path())).map_or(0, |packed| packed.len())
    };
    let (databases, texts) = databases();
    // Without a mode records are kept for later frames of the session and never written to a file.
    databases.save(&file, POINTS, mode(""), None, &records(3));
    assert_eq!(count(&databases, ""), 0, "a frame does not see what it saves");
    assert_eq!(databases.finish(&path(folder.path())).unwrap().written.len(), 0);
    assert_eq!(count(&databases, ""), 3);
    databases.save(&file, POINTS, mode(""), None, &records(2));
    databases.finish(&path(folder.path())).unwrap();
    assert_eq!(count(&databases, ""), 5);
    assert!(!Path::new(&file).exists());
    // Records that are written are in the file from then on.
    databases.save(&file, POINTS, mode("w"), None, &records(4));
    databases.finish(&path(folder.path())).unwrap();
    assert_eq!((count(&databases, ""), count(&databases, "r"), count(&databases, "ro")), (0, 4, 4));
    // "w" and "wo" replace the file, and "rw" adds to it.
    databases.save(&file, POINTS, mode("wo"), None, &records(6));
    databases.finish(&path(folder.path())).unwrap();
    assert_eq!(count(&databases, "r"), 6);
    databases.save(&file, POINTS, mode("rw"), None, &records(7));
    databases.finish(&path(folder.path())).unwrap();
    assert_eq!(count(&databases, "r"), 13);
    assert!(texts().is_empty(), "{:?}", texts());
    // "rw" on a file that does not exist is not an error.
    let new = name(&folder, "new.sdb");
    assert!(databases.records(&new, mode("rw"), &path(folder.path())).is_none());
    databases.save(&new, POINTS, mode("rw"), None, &records(1));
    databases.finish(&path(folder.path())).unwrap();
    assert_eq!(databases.records(&new, mode("r"), &path(folder.path())).unwrap().len(), 1);
    assert!(texts().is_empty(), "{:?}", texts());
}

#[test]
fn attributes_replace_omitted_modes() {
    let attributes = Attributes {
        read: vec!["a".to_owned()],
        write: vec!["a".to_owned(), "c".to_owned()],
        readonly: vec!["c".to_owned()],
        writeonly: vec!["d".to_owned()],
    };
    let of = |name: &str, word: &str| attributes.mode(name, mode(word));
    assert_eq!(of("a", ""), mode("rw"));
    assert_eq!(of("a", "w"), mode("w"), "an option comes before");
    assert_eq!(of("b", ""), mode(""));
    assert_eq!(of("c", ""), mode("ro"));
    assert_eq!(of("d", ""), mode("wo"));
    let (databases, texts) = databases();
    assert_eq!(databases.mode(&attributes, "a", "x"), mode("rw"));
    assert!(texts()[0].contains("no file mode \"x\""), "{:?}", texts());
}

#[test]
fn records_of_another_type_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    let file = name(&folder, "a.sdb");
    let (databases, texts) = databases();
    let mut some = records(3);
    some[7] = f32::NAN;
    databases.save(&file, POINTS, mode("w"), None, &some);
    let other = Schema { key: Key::Surface, value: Value::Float };
    for _ in 0..3 {
        databases.save(&file, other, mode("w"), None, &[0.0, 0.0, 1.0]);
    }
    assert_eq!(databases.finish(&path(folder.path())).unwrap().records, 2);
    let texts = texts();
    assert_eq!(texts.len(), 2, "{texts:?}");
    assert!(texts[0].contains("holds color by points: float by (s, t) is not added"), "{texts:?}");
    assert!(texts[1].contains("1 records are not finite"), "{texts:?}");
    // Points cannot be written as an image.
    let image = name(&folder, "a.tif");
    databases.save(&image, POINTS, mode("w"), None, &records(3));
    let error = databases.finish(&path(folder.path())).unwrap_err()[0].to_string();
    assert!(error.contains("a.tif") && error.contains("only (s, t) can"), "{error}");
}

#[test]
fn surface_records_are_written_as_images() {
    let folder = tempfile::tempdir().unwrap();
    let schema = Schema { key: Key::Surface, value: Value::Color };
    let ramp: Vec<f32> =
        (0..4000).flat_map(|i| [unit(i, 0), unit(i, 1), unit(i, 0), unit(i, 1), 0.25]).collect();
    let (databases, _) = databases();
    for (file, data_format) in [("a.tif", "float"), ("b.exr", "half"), ("c.png", "8")] {
        let options =
            ImageOptions { resolution: [20, 10], data_format: data_format.to_owned(), filter_width: 4.0 };
        databases.save(&name(&folder, file), schema, mode("wo"), Some(&options), &ramp);
    }
    assert_eq!(databases.finish(&path(folder.path())).unwrap().written.len(), 3);
    let formats = granita_plugin::bundled_formats(Limits::default());
    for file in ["a.tif", "b.exr", "c.png"] {
        let input = formats.open(&folder.path().join(file)).unwrap();
        let spec = input.spec(0, 0).unwrap();
        assert_eq!((spec.width, spec.height, spec.nchannels()), (20, 10, 3));
        let pixels = input.read_level(0, 0).unwrap().to_floats();
        for (i, rgb) in pixels.chunks(3).enumerate() {
            let (s, t) = ((i % 20) as f32 + 0.5, (i / 20) as f32 + 0.5);
            assert!(
                (rgb[0] - s / 20.0).abs() < 0.03 && (rgb[1] - t / 10.0).abs() < 0.06,
                "{file} {i} {rgb:?}"
            );
            assert!((rgb[2] - 0.25).abs() < 0.01);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    /// For any records the file gives the same results as memory, to the bit.
    #[test]
    fn files_give_the_same_results_as_memory(
        numbers in prop::collection::vec(prop::num::f32::NORMAL | prop::num::f32::ZERO | prop::num::f32::SUBNORMAL, 0..900),
        at in prop::array::uniform3(-2.0_f32..2.0),
    ) {
        let schema = Schema { key: Key::Oriented, value: Value::Float };
        let numbers = &numbers[..numbers.len() / 7 * 7];
        let memory = granita_sdb::Packed::new(schema, numbers);
        let folder = tempfile::tempdir().unwrap();
        let (databases, _) = databases();
        let file = name(&folder, "p.sdb");
        databases.save(&file, schema, mode("w"), None, numbers);
        databases.finish(&path(folder.path())).unwrap();
        let stored = read(Path::new(&file)).unwrap();
        let bits = |v: &[f32]| v.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        prop_assert_eq!(bits(memory.records()), bits(stored.records()));
        let how = Between { minsamples: 3, maxdist: 10.0, maxerror: 0.5, always: true };
        let probe = Probe { p: at, n: Some([0.0, 0.0, 1.0]) };
        let answer = |p: &granita_sdb::Packed| p.between(&probe, &how).map(|v| v.map(f32::to_bits));
        prop_assert_eq!(answer(&memory), answer(&stored));
    }
}
