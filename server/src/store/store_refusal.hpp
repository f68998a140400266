#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>

namespace stillmap::server {

/// A change that the store's present state does not allow; nothing was changed.
class StoreRefusal : public std::runtime_error {
 public:
  enum class Reason : std::uint8_t {
    kUnknownMap,
    kUnknownVersion,
    kOtherDigest,    ///< a version of that name holds something else
    kActive,         ///< the active version, or one that is rolled out, cannot be removed
    kNoPrevious,     ///< nothing to roll back to
    kOtherRevision,  ///< the map has changed since the caller looked
    kOverQuota,      ///< it would take more bytes than allowed
    kDiskReserve,    ///< it would take bytes of the disk that are to stay free
    kInUse,          ///< an unfinished job or a drive needs it
    kUnknownKey,
    kUnknownJob,
    kOtherRequest,   ///< the idempotency key was used for another request
    kNotProcessing,  ///< nobody is working on the job
    kJobFinished,
    kUnknownDrive,
    kDriveNotOpen,      ///< its upload has ended
    kDriveNotComplete,  ///< its upload has not ended well
    kPartsMissing,
    kOtherServer,  ///< what it needs is in the folders of different servers
    kNotSigned,    ///< no trusted key has signed it
  };
  StoreRefusal(Reason reason, const std::string& message)
      : std::runtime_error(message), reason_(reason) {}
  [[nodiscard]] Reason reason() const { return reason_; }

 private:
  Reason reason_;
};

}  // namespace stillmap::server
