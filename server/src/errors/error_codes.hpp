#pragma once

#include <span>
#include <string_view>

namespace stillmap::server {

/// Everything that can go wrong with a request. The texts in the table are stable: clients branch
/// on them.
enum class ErrorCode {
  kInvalidRequest,
  kUnknownParameter,
  kUnknownMethod,
  kInvalidScan,
  kInvalidSeal,
  kMissingKey,
  kRefusedKey,
  kForbidden,
  kReadOnly,
  kNotSigned,
  kUnknownRoute,
  kUnknownMap,
  kUnknownVersion,
  kUnknownTile,
  kUnknownLayer,
  kUnknownDrive,
  kUnknownUpload,
  kUnknownJob,
  kUnknownKey,
  kUnknownSession,
  kUnknownSet,
  kMethodNotAllowed,
  kNotAcceptable,
  kNoActiveVersion,
  kOtherDigest,
  kVersionActive,
  kVersionUnusable,
  kNoPrevious,
  kOtherFrame,
  kInUse,
  kOtherRequest,
  kJobFinished,
  kDriveNotOpen,
  kDriveNotComplete,
  kPartsMissing,
  kOtherServer,
  kSealExpired,
  kSealedVersionGone,
  kScanNotNewer,
  kLengthRequired,
  kRevisionChanged,
  kPayloadTooLarge,
  kUnsupportedMediaType,
  kRangeNotSatisfiable,
  kInvalidPrior,
  kInvalidTransform,
  kInvalidOdometry,
  kNoGeodeticOrigin,
  kInvalidPoints,
  kInvalidBoxes,
  kInvalidUpload,
  kTooFewPoints,
  kNoPose,
  kSuperseded,
  kTooManyRequests,
  kHeaderTooLarge,
  kClientGone,
  kInternalError,
  kStorageError,
  kNoMapper,
  kBusy,
  kTooManyStreams,
  kMapLoading,
  kMapUnusable,
  kBeingMade,
  kDerivedUnavailable,
  kStateAway,
  kPackagesAway,
  kDeadlineExceeded,
  kOverQuota,
  kDiskFull,
};

struct ErrorInfo {
  ErrorCode code;
  /// What a program looks at.
  std::string_view text;
  /// What a person reads.
  std::string_view title;
  int http_status;
};

[[nodiscard]] const ErrorInfo& info_of(ErrorCode code);
/// The whole table, in the order of the enumeration.
[[nodiscard]] std::span<const ErrorInfo> all_errors();

}  // namespace stillmap::server
