//! What may stand after `deaflow export`.

use std::path::PathBuf;

use clap::{Args, Subcommand, ValueEnum};

use super::StoreArguments;

#[derive(Debug, Args)]
pub struct ExportArguments {
    #[command(subcommand)]
    pub what: Exported,
}

#[derive(Debug, Subcommand)]
pub enum Exported {
    /// A design as a mask in mm (svg, dxf, gerber, png, csv) or as a deformed membrane (vtkhdf)
    Design(ExportDesignArguments),
    /// A trained model as a safetensors or an ONNX file
    Model(ExportModelArguments),
}

#[derive(Debug, Args)]
pub struct ExportDesignArguments {
    /// A stage of kind design or verify: PIPELINE.yaml:STAGE, a stage of the last run, a digest or its beginning, or a file;
    /// or with --scene a pattern: FILE.npy, FILE.csv, FILE.png or FILE.h5:/dataset
    pub source: String,
    /// Where it goes: a file, which is replaced, or a folder
    #[arg(short, long, value_name = "FILE|DIR")]
    pub output: PathBuf,
    /// The format [default: by the end of the file's name]
    #[arg(long, value_enum)]
    pub format: Option<DesignFormat>,
    /// The target whose design it is [default: the only one]
    #[arg(long, value_name = "NAME", conflicts_with = "scene")]
    pub design: Option<String>,
    /// The case of that target
    #[arg(long, value_name = "TEXT", conflicts_with = "scene")]
    pub case: Option<String>,
    /// refined, ga, optimum, intuitive or intuitive-equal-area [default: the first of these that there is]
    #[arg(long, conflicts_with = "scene")]
    pub role: Option<String>,
    /// Which of the different designs of the target [default: the best, 0]
    #[arg(long, value_name = "N", conflicts_with = "scene")]
    pub member: Option<u64>,
    /// The design with so many units along a side
    #[arg(long, value_name = "N", conflicts_with = "scene")]
    pub units: Option<u64>,
    /// The scene of a pattern, or a pipeline whose scene is meant; a YAML file
    #[arg(long, value_name = "SCENE")]
    pub scene: Option<PathBuf>,
    /// The size of a mask: on the frame, or before the membrane is stretched [default: prestretched]
    #[arg(long, value_enum)]
    pub size: Option<DesignSize>,
    /// Round the outline; the area that it holds is stated beside that of the cells
    #[arg(long)]
    pub smooth: bool,
    /// Resolution of an image; the nearest with a whole number of pixels for each cell is taken [default: 20]
    #[arg(long, value_name = "N", value_parser = resolution)]
    pub pixels_per_mm: Option<f64>,
    /// Elements along one side of a cell of a deformed membrane [default: 2]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=8))]
    pub elements_per_cell: Option<u64>,
    /// Polynomial order of these elements [default: 2]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=2))]
    pub order: Option<u64>,
    #[command(flatten)]
    pub store: StoreArguments,
    /// Print one JSON document on stdout
    #[arg(long)]
    pub json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum DesignSize {
    /// Before the membrane is stretched
    Undeformed,
    /// As it lies on the frame, without voltage
    Prestretched,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum DesignFormat {
    /// Polygons for browsers, laser cutters and plotters
    Svg,
    /// Polygons for CAD
    Dxf,
    /// Regions for makers of circuit boards and photomasks
    Gerber,
    /// An image, black where the electrode is
    Png,
    /// Cells as numbers
    Csv,
    /// The deformed membrane with stress and field, for ParaView
    Vtkhdf,
}

impl DesignFormat {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::Svg, Self::Dxf, Self::Gerber, Self::Png, Self::Csv, Self::Vtkhdf];

    /// The word for it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Svg => "svg",
            Self::Dxf => "dxf",
            Self::Gerber => "gerber",
            Self::Png => "png",
            Self::Csv => "csv",
            Self::Vtkhdf => "vtkhdf",
        }
    }

    /// How files of the format end, the usual way first.
    pub fn extensions(self) -> &'static [&'static str] {
        match self {
            Self::Gerber => &["gbr", "ger", "gerber"],
            Self::Svg => &["svg"],
            Self::Dxf => &["dxf"],
            Self::Png => &["png"],
            Self::Csv => &["csv"],
            Self::Vtkhdf => &["vtkhdf"],
        }
    }
}

fn resolution(text: &str) -> Result<f64, String> {
    let value = text.parse::<f64>().map_err(|e| e.to_string())?;
    if (1e-3..=1e6).contains(&value) {
        Ok(value)
    } else {
        Err("allowed: 0.001 to 1e6 pixels per mm".to_owned())
    }
}

#[derive(Debug, Args)]
pub struct ExportModelArguments {
    /// A digest or its beginning, a stage of the last run, PIPELINE.yaml:STAGE, or a file
    pub model: String,
    /// Where it goes: a file, which is replaced, or a folder
    #[arg(short, long, value_name = "FILE|DIR")]
    pub output: PathBuf,
    /// The format [default: by the end of the file's name]
    #[arg(long, value_enum)]
    pub format: Option<ModelFormat>,
    #[command(flatten)]
    pub store: StoreArguments,
    /// Print one JSON document on stdout
    #[arg(long)]
    pub json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ModelFormat {
    /// Tensors, with a header that says everything needed to use them
    Safetensors,
    /// The whole network as a graph
    Onnx,
}

impl ModelFormat {
    /// How files of the format end.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Safetensors => "safetensors",
            Self::Onnx => "onnx",
        }
    }
}
