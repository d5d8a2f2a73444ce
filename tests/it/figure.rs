//! A figure of a stage kind is one presenter, which may come from outside.

use std::path::Path;

use deaflow::report::drawing::{Axis, Chart, Colour, Mark, Series, Sheet};
use deaflow::report::{ArtifactReader, DrawFigure, Presenter, ReportError, RunArtifacts, StageArtifact, draw_figures};
use deaflow::store::{Data, Dataset, Object, Provenance, Store};

struct Toy;

impl Presenter for Toy {
    fn kind(&self) -> &'static str {
        "toy"
    }

    fn figures(&self) -> &'static [(&'static str, DrawFigure)] {
        &[("line", line)]
    }
}

fn line(source: &ArtifactReader<'_>) -> Result<Option<Sheet>, ReportError> {
    let (_, values) = source.artifact.f64s("values")?;
    let axes = [
        Axis::counting("Place", 0.0, values.len() as f64),
        Axis::above("Value [mm]", &values),
    ];
    let points = (0..).map(f64::from).zip(values).collect();
    let series = vec![Series::new("values", Colour::Blue, Mark::LineAndDots, points)];
    Ok(Some(Sheet::charts(1, &[Chart::new("Toy", axes, series)])))
}

#[test]
fn a_presenter_from_outside_draws_a_figure() {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(&folder.path().join("store")).unwrap();
    let values = Dataset::new("mm", "d", &[3], Data::F64(vec![1.0, 3.0, 2.0]));
    let object = Object::default().with("values", values);
    let made = [StageArtifact {
        stage: "mine".into(),
        kind: "toy".into(),
        digest: store.put(&object, &Provenance::default()).unwrap().digest,
    }];
    let run = RunArtifacts {
        store: &store,
        file: Path::new("/p.yaml"),
        stages: &made,
        rounds: &[],
    };
    let drawn = draw_figures(&[&Toy], &run, "p").unwrap();
    let [path] = &drawn[..] else { panic!("{drawn:?}") };
    assert!(path.ends_with(format!("figures/p/mine-{}-line.png", &made[0].digest.to_string()[..8])));
    let mut reader = png::Decoder::new(std::fs::File::open(path).unwrap())
        .read_info()
        .unwrap();
    let mut pixels = vec![0; reader.output_buffer_size()];
    reader.next_frame(&mut pixels).unwrap();
    let blue = pixels.chunks_exact(3).filter(|pixel| *pixel == [0, 114, 178]).count();
    assert!(blue > 100, "{blue}");
}
