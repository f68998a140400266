#include "jobs/job_folders.hpp"

#include "errors/upload_errors.hpp"
#include "jobs/job_attempt.hpp"
#include "mapper/slurm_name.hpp"
#include "store/ids_and_times.hpp"

#include "store/store_refusal.hpp"

#include <spdlog/spdlog.h>

#include <chrono>
#include <exception>
#include <optional>
#include <system_error>
#include <utility>

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

/// In the store.
constexpr const char* kJobs = "jobs";

/// Of the build whose follower worked in this folder.
bool cancel_in_cluster(const fs::path& folder) {
  const std::optional<std::string> plan = read_small_file(folder / mapper::kSlurmPlan);
  if (!plan) return true;
  constexpr std::chrono::seconds kMost{10};
  try {
    const ProgramOutput output =
        run_short({"/usr/bin/env", "scancel", "--name=" + mapper::slurm_job_name(*plan)}, {}, kMost,
                  [] { return false; });
    if (output.end.signal == 0 && output.end.exit_code == 0) return true;
    spdlog::warn("{}: its jobs could not be cancelled: scancel: {}: {}", folder.string(),
                 output.end.words(), output.text);
  } catch (const std::exception& error) {
    spdlog::warn("{}: its jobs could not be cancelled: {}", folder.string(), error.what());
  }
  return false;
}

}  // namespace

JobFolders::JobFolders(const JobOptions& options, PackageStore& store)
    : store_(store),
      root_(options.work_dir.empty() ? store.folder() / kJobs : fs::path(options.work_dir)) {}

fs::path JobFolders::of_store() const { return store_.folder() / kJobs; }

bool JobFolders::has_files_of(const std::string& server) const {
  return server.empty() || !store_.state().is_shared() || server == server_of(root_) ||
         server == server_of(of_store());
}

std::string JobFolders::without_places(std::string text) const {
  // `root_` may lie elsewhere, but holds what "jobs" of the store does.
  const std::string root = root_.string() + "/";
  const std::string usual = (of_store() / "").string();
  for (std::size_t at = text.find(root); root != usual && at != std::string::npos;
       at = text.find(root, at + usual.size()))
    text.replace(at, root.size(), usual);
  return without_folder(std::move(text), store_.folder());
}

void JobFolders::clear_work(const JobFolder& job) const {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(job.work(), error))
    if (entry.path().extension() == mapper::kSlurmFolder && !cancel_in_cluster(entry.path()))
      return;
  clear_folder(job.scratch());
}

void JobFolders::clear_forgotten() const {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(root_, error)) {
    const std::optional<std::int64_t> id = id_in(entry.path().filename().string());
    if (!id) continue;
    try {
      const StoredJob job = store_.jobs().job(*id);
      if (is_finished(job.status)) clear_work(of(*id));
    } catch (const StoreRefusal&) {
      clear_work(of(*id));
      if (!fs::exists(of(*id).scratch(), error)) clear_folder(entry.path());
    }
  }
}

}  // namespace stillmap::server
