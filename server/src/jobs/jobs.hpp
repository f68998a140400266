#pragma once

#include "jobs/job_folders.hpp"
#include "jobs/job_orders.hpp"
#include "jobs/job_runner.hpp"
#include "jobs/job_setup.hpp"
#include "jobs/job_uploads.hpp"
#include "jobs/live_jobs.hpp"

namespace stillmap::server {

/// All that the server does with jobs (server/operation.md, "Jobs"). Each part uses those above it.
struct Jobs {
  explicit Jobs(const JobSetup& with)
      : setup(with),
        folders(setup.live.current()->jobs, setup.store),
        uploads(setup.store, folders),
        live(setup, folders, uploads),
        runner(setup, folders, uploads, live),
        orders(setup, folders, uploads, [this] { runner.wake(); }) {}
  Jobs(const Jobs&) = delete;
  Jobs& operator=(const Jobs&) = delete;

  const JobSetup setup;
  const JobFolders folders;
  /// Map files on their way to a job.
  JobUploads uploads;
  /// How far jobs are; their events and their cancelling.
  LiveJobs live;
  /// Does them.
  JobRunner runner;
  /// Takes orders for them.
  JobOrders orders;
};

}  // namespace stillmap::server
