#pragma once

#include "catalog/map_catalog.hpp"
#include "jobs/child_process.hpp"
#include "metrics/metrics.hpp"

#include <stillmap/server/options_holder.hpp>
#include "store/drive_store.hpp"
#include "store/package_store.hpp"

#include <chrono>
#include <filesystem>

namespace stillmap::server {

/// What jobs work with. All of it outlives them.
struct JobSetup {
  const OptionsHolder& live;
  PackageStore& store;
  DriveStore& drives;
  MapCatalog& catalog;
  Metrics& metrics;
  /// Program; empty when there is none: jobs then fail and say so.
  std::filesystem::path mapper;
  /// How long a job first waits for room on a full disk; then five times as long each time.
  /// Short at first: what filled the disk may have been a file that is gone again.
  std::chrono::milliseconds first_pause_when_full = std::chrono::seconds(2);
  /// Where servers share the state: how long the worker of a job says nothing until another one
  /// takes the job over. It says something six times as often.
  std::chrono::milliseconds silent_after = std::chrono::seconds(30);

  /// Of the mapper, by the options as they are now.
  [[nodiscard]] ProcessLimits limits() const {
    const JobOptions jobs = live.current()->jobs;
    return {.nice = jobs.nice, .cores = jobs.cores, .memory_bytes = jobs.memory_bytes};
  }
};

}  // namespace stillmap::server
