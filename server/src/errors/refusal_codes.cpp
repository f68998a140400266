#include "errors/refusal_codes.hpp"

#include <cerrno>
#include <system_error>

namespace stillmap::server {

ErrorCode code_of(StoreRefusal::Reason reason) {
  using Reason = StoreRefusal::Reason;
  switch (reason) {
    case Reason::kUnknownMap:
      return ErrorCode::kUnknownMap;
    case Reason::kUnknownVersion:
      return ErrorCode::kUnknownVersion;
    case Reason::kOtherDigest:
      return ErrorCode::kOtherDigest;
    case Reason::kActive:
      return ErrorCode::kVersionActive;
    case Reason::kNoPrevious:
      return ErrorCode::kNoPrevious;
    case Reason::kOtherRevision:
      return ErrorCode::kRevisionChanged;
    case Reason::kOverQuota:
      return ErrorCode::kOverQuota;
    case Reason::kDiskReserve:
      return ErrorCode::kDiskFull;
    case Reason::kInUse:
      return ErrorCode::kInUse;
    case Reason::kUnknownKey:
      return ErrorCode::kUnknownKey;
    case Reason::kUnknownJob:
      return ErrorCode::kUnknownJob;
    case Reason::kOtherRequest:
      return ErrorCode::kOtherRequest;
    case Reason::kNotProcessing:
    case Reason::kJobFinished:
      return ErrorCode::kJobFinished;
    case Reason::kUnknownDrive:
      return ErrorCode::kUnknownDrive;
    case Reason::kDriveNotOpen:
      return ErrorCode::kDriveNotOpen;
    case Reason::kDriveNotComplete:
      return ErrorCode::kDriveNotComplete;
    case Reason::kPartsMissing:
      return ErrorCode::kPartsMissing;
    case Reason::kOtherServer:
      return ErrorCode::kOtherServer;
    case Reason::kNotSigned:
      return ErrorCode::kNotSigned;
  }
  return ErrorCode::kInternalError;
}

bool is_disk_full(const std::filesystem::filesystem_error& error) {
  return error.code() == std::errc::no_space_on_device ||
         error.code() == std::error_code(EDQUOT, std::generic_category());
}

}  // namespace stillmap::server
