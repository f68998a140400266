/// Reads an MRPT rawlog from its standard input and says on its standard output what clouds and
/// poses it holds (`rawlogs/rawlog_record.hpp`). Whatever a rawlog makes MRPT do, it happens here.

#include <mrpt/maps/registerAllClasses.h>
#include <mrpt/obs/registerAllClasses.h>

#include <fcntl.h>
#include <unistd.h>

#include "reading.hpp"

int main() {
  // MRPT talks on standard output, which is ours.
  const int records = ::fcntl(STDOUT_FILENO, F_DUPFD_CLOEXEC, STDERR_FILENO + 1);
  ::dup2(STDERR_FILENO, STDOUT_FILENO);
  mrpt::obs::registerAllClasses_mrpt_obs();
  mrpt::maps::registerAllClasses_mrpt_maps();
  stillmap::maps::rawlog::confine();
  stillmap::maps::rawlog::RecordOutput output(records);
  try {
    stillmap::maps::rawlog::read("/proc/self/fd/0", output);
  } catch (...) {
    return 1;
  }
  return 0;
}
