//! Reads Pyg files into the state machine, and prints the frames, commands and inputs and the speed.
#![allow(clippy::print_stdout, reason = "telling is what it is for")]

use granita_base::{Location, Param, Params, Reporter};
use granita_pyg::{PygOptions, PygSource, read};
use granita_scene::{FoundInput, FrameRenderer, InputPaths, Scene, State, Stop};
use std::sync::Arc;

struct Tell;

impl FrameRenderer for Tell {
    fn render(&mut self, scene: Arc<Scene>, camera: Option<&str>) -> Result<(), Stop> {
        println!(
            "  Render {camera:?}: {} primitives, {} lights, cameras {:?}, outputs {:?}",
            scene.primitives.len(),
            scene.lights.len(),
            scene.cameras.iter().map(|c| &c.name).collect::<Vec<_>>(),
            scene.outputs.iter().map(|o| &o.name).collect::<Vec<_>>()
        );
        Ok(())
    }
    fn command(&mut self, name: &str, params: &Params, _: &Location) -> Result<bool, Stop> {
        println!("  Command {name} {:?}", params.iter().map(Param::declaration).collect::<Vec<_>>());
        Ok(true)
    }
    fn input(&mut self, command: &str, _: InputPaths<'_>, _: &Location) -> Result<Option<FoundInput>, Stop> {
        println!("  Input {command}");
        Ok(None)
    }
}

fn main() {
    for path in std::env::args().skip(1) {
        println!("{path}");
        let bytes = std::fs::metadata(&path).map_or(0, |m| m.len());
        let reporter = Reporter::new(Box::new(|m| println!("  {m}")));
        let mut state = State::new(Box::new(Tell), reporter.clone());
        let start = std::time::Instant::now();
        let result = read(PygSource::Path(path.into()), &mut state, &PygOptions::default(), &reporter);
        let seconds = start.elapsed().as_secs_f64();
        state.end();
        println!("  {result:?}, {:.1} MB/s", bytes as f64 / seconds / 1.0e6);
    }
}
