#pragma once

#include <stillmap/mapping/progress.hpp>

#include <CLI/CLI.hpp>

namespace stillmap::mapper {

/// Each adds one subcommand, with its options, help and callback.
void add_build(CLI::App& app);
void add_rebuild(CLI::App& app);
void add_import(CLI::App& app);
void add_export(CLI::App& app);
void add_calibrate(CLI::App& app);
void add_simulate(CLI::App& app);
/// For `inspect --motion`; no help lists it.
void add_check_poses(CLI::App& app);

}  // namespace stillmap::mapper
