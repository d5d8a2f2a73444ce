//! The table of commands. A new command is a file with its arguments and `execute`, and one line here.

mod completions;
mod man;

use std::ffi::OsString;
use std::fmt::Write;
use std::ops::RangeInclusive;
use std::sync::LazyLock;

use clap::builder::StyledStr;
use clap::{Args, ColorChoice, CommandFactory, FromArgMatches, Parser, Subcommand, ValueEnum};

use super::arguments::bare_numbers;
use super::examples::HEADING;
use super::tone::width_of_stdout;
use super::{
    CliError, Exit, Output, accuracy, attach, audit, check, columns, compare, copy, dag, diff, doctor, explain, export,
    fit, fsck, gc, init, log, measure, pin, plan, predict, pull, push, remote, report, run, schema, screen, serve,
    show, sketch, solve, status, sweep, unpin, worker, yields,
};

/// The name of the program.
const PROGRAM: &str = "deaflow";

/// The environment variable for the number of threads.
pub const JOBS: &str = "DEAFLOW_JOBS";

/// The allowed numbers of threads.
pub const ALLOWED_JOBS: RangeInclusive<u16> = 1..=1024;

/// The largest width of the help.
const MAX_WIDTH: usize = 100;

/// The smallest width of the descriptions in the list of commands.
const MIN_WIDTH: usize = 20;

/// The text of `--version`.
static VERSION: LazyLock<String> = LazyLock::new(deaflow_base::version);

/// Design dielectric elastomer actuators reproducibly: sample, solve, balance, train, design, verify
#[derive(Debug, Parser)]
#[command(
    name = PROGRAM,
    version = VERSION.as_str(),
    about,
    propagate_version = true,
    after_help = examples!("deaflow init demo", "deaflow run demo/pipeline.yaml", "deaflow help run")
)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    pub global: GlobalArguments,
}

#[derive(Debug, Args)]
#[command(next_help_heading = "Global options")]
pub struct GlobalArguments {
    /// Print one JSON document on stdout; progress goes to stderr in any case
    #[arg(long, global = true)]
    pub json: bool,
    /// Number of threads [default: $DEAFLOW_JOBS, or one per core]; results do not depend on it
    #[arg(short, long, global = true, value_name = "N", value_parser = jobs)]
    pub jobs: Option<u16>,
    /// Use colours: auto, always or never; auto respects NO_COLOR and CLICOLOR_FORCE
    #[arg(
        long,
        global = true,
        value_name = "WHEN",
        default_value = "auto",
        hide_default_value = true,
        hide_possible_values = true
    )]
    pub color: ColorChoice,
}

/// Parses a number of threads.
pub fn jobs(text: &str) -> Result<u16, String> {
    let number = text.trim().parse().ok().filter(|number| ALLOWED_JOBS.contains(number));
    number.ok_or_else(|| format!("allowed: {} to {}", ALLOWED_JOBS.start(), ALLOWED_JOBS.end()))
}

/// Declares the commands in the order of `deaflow --help`, under headings. The comment on its arguments describes a
/// command.
macro_rules! commands {
    ($($heading:literal: $($command:ident => $file:ident::$arguments:ident,)*)*) => {
        #[derive(Debug, Subcommand)]
        enum Command {
            $($($command($file::$arguments),)*)*
        }

        /// Names of commands by heading.
        const GROUPS: &[(&str, &[&str])] = &[$(($heading, &[$(stringify!($command)),*])),*];

        impl Cli {
            /// Runs the command.
            pub fn execute(&self, output: &Output) -> Result<Exit, CliError> {
                bare_numbers().into_iter().for_each(|note| output.warn_of_units(note));
                match &self.command {
                    $($(Command::$command(arguments) => $file::execute(arguments, output),)*)*
                }
            }
        }
    };
}

commands! {
    "Start and build":
    Init => init::InitArguments,
    Run => run::RunArguments,
    Plan => plan::PlanArguments,
    Sweep => sweep::SweepArguments,
    Status => status::StatusArguments,
    Attach => attach::AttachArguments,
    Worker => worker::WorkerArguments,
    "Look and export":
    Log => log::LogArguments,
    Diff => diff::DiffArguments,
    Explain => explain::ExplainArguments,
    Dag => dag::DagArguments,
    Show => show::ShowArguments,
    Report => report::ReportArguments,
    Export => export::ExportArguments,
    Serve => serve::ServeArguments,
    "Store and exchange":
    Fsck => fsck::FsckArguments,
    Gc => gc::GcArguments,
    Doctor => doctor::DoctorArguments,
    Pin => pin::PinArguments,
    Unpin => unpin::UnpinArguments,
    Copy => copy::CopyArguments,
    Remote => remote::RemoteCommand,
    Push => push::PushArguments,
    Pull => pull::PullArguments,
    "Solve and measure":
    Solve => solve::SolveArguments,
    Sketch => sketch::SketchArguments,
    Predict => predict::PredictArguments,
    Check => check::CheckArguments,
    Screen => screen::ScreenArguments,
    Yield => yields::YieldArguments,
    Accuracy => accuracy::AccuracyArguments,
    Measure => measure::MeasureArguments,
    Fit => fit::FitArguments,
    Compare => compare::CompareArguments,
    Audit => audit::AuditArguments,
    "Help and set-up":
    Schema => schema::SchemaArguments,
    Completions => completions::CompletionsArguments,
    Man => man::ManArguments,
}

/// The command that clap adds to the last group.
const HELP: (&str, &str) = ("help", "Print the help of a command");

impl Cli {
    /// Parses a command line.
    ///
    /// # Errors
    /// When it is invalid, or help was requested.
    pub fn read(arguments: &[OsString], colour: ColorChoice) -> Result<Self, clap::Error> {
        let mut command = command_line().color(colour);
        let matches = command.try_get_matches_from_mut(arguments)?;
        Self::from_arg_matches(&matches).map_err(|error| error.format(&mut command))
    }
}

/// Finds `--color` without clap; an invalid value is refused later.
pub fn colour_in(arguments: &[OsString]) -> ColorChoice {
    let words = arguments.iter().filter_map(|word| word.to_str());
    let next = words.clone().skip(1).map(Some).chain([None]);
    let given = words.zip(next).filter_map(|(word, next)| match word {
        "--color" => next,
        word => word.strip_prefix("--color="),
    });
    let read = given.filter_map(|word| ColorChoice::from_str(word, false).ok());
    read.last().unwrap_or(ColorChoice::Auto)
}

/// Returns the declared command line, with the commands under their headings.
pub fn command_line() -> clap::Command {
    let command = Cli::command().max_term_width(MAX_WIDTH);
    let overview = overview(&command, width_of_stdout().unwrap_or(MAX_WIDTH).min(MAX_WIDTH));
    with_negative_values(with_styled_examples(command)).help_template(overview)
}

/// Names of values that are numbers or quantities.
const NUMBERS: [&str; 12] = [
    "N", "S", "R", "K", "TIME", "TIMES", "LENGTH", "VOLTAGE", "ANGLE", "X,Y", "A:B", "N|all",
];

/// Lets numbers begin with a minus sign, so that a negative one is refused as what it is, not as an unknown option.
fn with_negative_values(command: clap::Command) -> clap::Command {
    let is_number = |arg: &clap::Arg| {
        let names = arg.get_value_names().unwrap_or_default();
        !arg.is_positional() && names.iter().any(|name| NUMBERS.contains(&name.as_str()))
    };
    let command = command.mut_args(|arg| match is_number(&arg) {
        true => arg.allow_hyphen_values(true),
        false => arg,
    });
    command.mut_subcommands(with_negative_values)
}

/// Formats the help of the program in lines of at most `width` columns. Clap has no headings for commands.
fn overview(command: &clap::Command, width: usize) -> StyledStr {
    let header = command.get_styles().get_header();
    let literal = command.get_styles().get_literal();
    let names = || command.get_subcommands().map(|command| command.get_name().len());
    let name_width = names().max().unwrap_or(0);
    let mut text = "{about-with-newline}\n{usage-heading} {usage}\n".to_owned();
    let line = |text: &mut String, name: &str, about: &str| {
        let wrapping = columns::words(width.saturating_sub(name_width + 4).max(MIN_WIDTH));
        let mut lines = textwrap::wrap(about, wrapping).into_iter();
        // Writing to a string cannot fail.
        let first = lines.next().unwrap_or_default();
        let _ = writeln!(text, "  {literal}{name:name_width$}{literal:#}  {first}");
        for rest in lines {
            let _ = writeln!(text, "{:1$}{rest}", "", name_width + 4);
        }
    };
    for (at, (heading, commands)) in GROUPS.iter().enumerate() {
        let _ = writeln!(text, "\n{header}{heading}:{header:#}");
        for name in *commands {
            let name = name.to_lowercase();
            let about = command.find_subcommand(&name).and_then(clap::Command::get_about);
            line(&mut text, &name, &about.map(ToString::to_string).unwrap_or_default());
        }
        if at + 1 == GROUPS.len() {
            line(&mut text, HELP.0, HELP.1);
        }
    }
    let _ = write!(text, "\n{header}Options:{header:#}\n{{options}}{{after-help}}");
    text.into()
}

/// Styles the headings of examples as clap styles its own.
fn with_styled_examples(command: clap::Command) -> clap::Command {
    let header = *command.get_styles().get_header();
    let text = command.get_after_help().map(ToString::to_string).unwrap_or_default();
    let command = match text.strip_prefix(HEADING) {
        Some(lines) => command.after_help(StyledStr::from(format!("{header}{HEADING}{header:#}{lines}"))),
        None => command,
    };
    command.mut_subcommands(with_styled_examples)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(command: &clap::Command, found: &mut Vec<clap::Command>) {
        found.push(command.clone());
        command.get_subcommands().for_each(|command| all(command, found));
    }

    /// Returns all commands and subcommands, without `help`.
    fn commands() -> Vec<clap::Command> {
        let mut found = Vec::new();
        all(&command_line(), &mut found);
        found
    }

    #[test]
    fn the_declaration_holds_together() {
        command_line().debug_assert();
    }

    #[test]
    fn every_command_has_a_short_description() {
        for command in commands().iter().skip(1) {
            let about = command.get_about().map(ToString::to_string).unwrap_or_default();
            assert!(!about.is_empty(), "{}", command.get_name());
            assert!(about.chars().count() <= 84, "{}: {about}", command.get_name());
        }
    }

    #[test]
    fn every_command_has_one_heading() {
        let named: Vec<String> = GROUPS
            .iter()
            .flat_map(|group| group.1)
            .map(|name| name.to_lowercase())
            .collect();
        let command = command_line();
        let known: Vec<&str> = command.get_subcommands().map(clap::Command::get_name).collect();
        assert_eq!(named, known);
    }

    #[test]
    fn examples_are_command_lines() {
        for command in commands()
            .iter()
            .filter(|command| !command.has_subcommands() || command.get_name() == PROGRAM)
        {
            let help = command.get_after_help().map(ToString::to_string).unwrap_or_default();
            let lines = help
                .strip_prefix(HEADING)
                .unwrap_or_default()
                .split("\n\n")
                .next()
                .unwrap_or_default();
            let lines: Vec<&str> = lines.lines().filter(|line| !line.is_empty()).collect();
            assert!((1..=3).contains(&lines.len()), "{}: {help}", command.get_name());
            for line in lines {
                let words = shlex::split(line).unwrap();
                // The part that the shell handles.
                let words = words.into_iter().take_while(|word| word != "|" && word != ">");
                let words: Vec<OsString> = words.map(OsString::from).collect();
                let read = Cli::read(&words, ColorChoice::Never);
                let is_help = words.get(1).is_some_and(|word| word == "help");
                assert!(read.is_ok() || is_help, "{line}: {}", read.unwrap_err());
                assert!(line.starts_with("  deaflow ") && line.len() <= MAX_WIDTH, "{line}");
            }
        }
    }

    #[test]
    fn negative_numbers_are_refused_as_what_they_are() {
        for line in [
            "deaflow solve s.yaml p.csv --history --every",
            "deaflow solve s.yaml p.csv --history --at",
            "deaflow solve s.yaml p.csv --order",
            "deaflow solve s.yaml p.csv --modes",
            "deaflow accuracy s.yaml --count",
            "deaflow accuracy s.yaml --target",
            "deaflow gc --grace",
            "deaflow log -n",
        ] {
            for value in ["-1", "-1 s"] {
                let words = line.split(' ').chain([value]).map(OsString::from).collect::<Vec<_>>();
                let error = Cli::read(&words, ColorChoice::Never).unwrap_err().to_string();
                assert!(error.contains(&format!("invalid value '{value}'")), "{line}: {error}");
            }
        }
    }

    #[test]
    fn help_fits_the_largest_width() {
        for mut command in commands() {
            let help = command.render_help().to_string();
            for line in help.lines() {
                assert!(line.chars().count() <= MAX_WIDTH, "{}: {line}", command.get_name());
            }
        }
    }

    #[test]
    fn the_list_of_commands_fits_a_narrow_terminal() {
        for width in [60, 80, 100] {
            let text = overview(&Cli::command(), width).to_string();
            let lines = text.lines().filter(|line| line.starts_with("  "));
            let mut words = String::new();
            for line in lines {
                assert!(line.chars().count() <= width, "{width}: {line}");
                words += line.trim_start();
                words += " ";
            }
            assert!(words.contains("so that others can reuse them"), "{words}");
        }
    }

    #[test]
    fn requested_colours_are_found_without_clap() {
        let found = |words: &str| colour_in(&words.split(' ').map(OsString::from).collect::<Vec<_>>());
        for (words, choice) in [
            ("deaflow run", ColorChoice::Auto),
            ("deaflow --color never run", ColorChoice::Never),
            ("deaflow run --color=always", ColorChoice::Always),
            ("deaflow run --color", ColorChoice::Auto),
            ("deaflow run --color pink", ColorChoice::Auto),
        ] {
            assert_eq!(found(words), choice, "{words}");
        }
    }
}
