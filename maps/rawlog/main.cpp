/// Reads an MRPT rawlog from its standard input and says on its standard output what clouds and
/// poses it holds (`rawlogs/rawlog_record.hpp`). Whatever a rawlog makes MRPT do, it happens here.
/// With `--write-simplemap FILE` it reads keyframes and writes them; on failure the reason goes to
/// standard output.

#include <mrpt/maps/registerAllClasses.h>
#include <mrpt/obs/registerAllClasses.h>

#include <fcntl.h>
#include <sys/prctl.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <exception>
#include <new>
#include <string_view>

#include "reading.hpp"
#include "simplemap.hpp"

int main(int count, char** words) {
  // MRPT talks on standard output, which is ours.
  const int records = ::fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, STDERR_FILENO + 1);
  ::dup2(STDERR_FILENO, STDOUT_FILENO);
  mrpt::obs::registerAllClasses_mrpt_obs();
  mrpt::maps::registerAllClasses_mrpt_maps();
  if (count == 3 && words[1] == std::string_view("--write-simplemap")) {
    ::prctl(PR_SET_PDEATHSIG, SIGKILL);
    try {
      stillmap::maps::rawlog::write_simplemap(stdin, words[2]);
    } catch (const std::bad_alloc&) {
      ::dprintf(records, "out of memory: a simplemap is written from there");
      return 1;
    } catch (const std::exception& error) {
      ::dprintf(records, "%s", error.what());
      return 1;
    }
    return 0;
  }
  stillmap::maps::rawlog::confine();
  stillmap::maps::rawlog::RecordOutput output(records);
  try {
    stillmap::maps::rawlog::read("/proc/self/fd/0", output);
  } catch (...) {
    return 1;
  }
  return 0;
}
