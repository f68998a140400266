#include "jobs/mapper_command.hpp"

#include "jobs/child_process.hpp"

#include <nlohmann/json.hpp>

#include <sstream>
#include <system_error>

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

void add_options(std::vector<std::string>& command, const RebuildRequest& request,
                 const RebuildSources& sources) {
  for (const fs::path& drive : sources.drives) command.push_back(drive.string());
  for (const auto& [name, value] : request.options) {
    command.push_back("--" + name);
    command.push_back(value);
  }
}

void add_threads(std::vector<std::string>& command, int threads) {
  if (threads <= 0) return;
  command.emplace_back("--threads");
  command.push_back(std::to_string(threads));
}

void add_cluster(std::vector<std::string>& command, const JobOptions& jobs) {
  command.insert(command.end(),
                 {"--executor", "slurm", "--units", std::to_string(jobs.slurm_units)});
  std::istringstream words(jobs.slurm_options);
  for (std::string word; words >> word;) command.push_back("--slurm-option=" + word);
}

}  // namespace

bool runs_in_cluster(const JobOptions& jobs) { return jobs.executor != "process"; }

fs::path find_mapper() {
  std::error_code error;
  const fs::path folder = fs::canonical("/proc/self/exe", error).parent_path();
  for (const fs::path& candidate :
       {folder / "stillmap-mapper", folder.parent_path() / "libexec/stillmap/stillmap-mapper"})
    if (!error && fs::exists(candidate)) return candidate;
  return {};
}

std::vector<std::string> rebuild_command(const fs::path& mapper, const RebuildRequest& request,
                                         const RebuildSources& sources, const JobFolder& folder,
                                         const JobOptions& jobs) {
  std::vector<std::string> command = {mapper.string(), "rebuild"};
  add_options(command, request, sources);
  const auto add = [&](const char* flag, const fs::path& path) {
    command.emplace_back(flag);
    command.push_back(path.string());
  };
  add("--output", folder.map());
  add("--work", folder.work());
  command.push_back("--json=" + folder.report().string());
  add("--gate", folder.gate());
  if (!request.edits.empty()) add("--edits", folder.edits());
  if (sources.held_back) add("--held-back", *sources.held_back);
  if (sources.previous) add("--previous", *sources.previous);
  if (request.patch) command.emplace_back("--patch");
  add_threads(command, jobs.cores);
  if (runs_in_cluster(jobs)) add_cluster(command, jobs);
  command.insert(command.end(),
                 {"--progress", "json", "--progress-fd", std::to_string(ChildProcess::kProgress)});
  return command;
}

std::vector<std::string> estimate_command(const fs::path& mapper, const RebuildRequest& request,
                                          const RebuildSources& sources) {
  std::vector<std::string> command = {mapper.string(), "rebuild"};
  add_options(command, request, sources);
  command.insert(command.end(), {"--estimate", "--json"});
  return command;
}

std::vector<std::string> convert_command(const fs::path& mapper, const fs::path& file,
                                         const JobFolder& folder, int threads) {
  std::vector<std::string> command = {mapper.string(), "import", file.string(), "--output",
                                      folder.map().string()};
  add_threads(command, threads);
  return command;
}

std::string gate_json(const QualityGateOptions& gate) {
  return nlohmann::ordered_json{
      {"found_below_keep", gate.max_success_loss},   {"new_lost", gate.max_new_lost},
      {"static_loss", gate.max_static_loss},         {"driven_coverage", gate.min_coverage},
      {"wall_thickening", gate.max_wall_thickening}, {"entropy_rise", gate.max_entropy_rise},
      {"first_found", gate.min_success_rate}}
      .dump();
}

}  // namespace stillmap::server
