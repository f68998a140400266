#include "errors/error_codes.hpp"

#include <array>

namespace stillmap::server {
namespace {

constexpr std::array kErrors = {
    ErrorInfo{ErrorCode::kInvalidRequest, "InvalidRequest", "The request cannot be read", 400},
    ErrorInfo{ErrorCode::kUnknownParameter, "UnknownParameter", "No such parameter here", 400},
    ErrorInfo{ErrorCode::kUnknownMethod, "UnknownMethod", "No such alignment method", 400},
    ErrorInfo{ErrorCode::kInvalidScan, "InvalidScan", "The scan cannot be decoded", 400},
    ErrorInfo{ErrorCode::kInvalidSeal, "InvalidSeal", "The seal cannot be used", 400},
    ErrorInfo{ErrorCode::kMissingKey, "MissingKey", "A key is needed", 401},
    ErrorInfo{ErrorCode::kRefusedKey, "RefusedKey", "The key is not valid", 401},
    ErrorInfo{ErrorCode::kForbidden, "Forbidden", "The request is not allowed", 403},
    ErrorInfo{ErrorCode::kReadOnly, "ReadOnly", "This server takes no changes", 403},
    ErrorInfo{ErrorCode::kNotSigned, "NotSigned", "No trusted key has signed the version", 403},
    ErrorInfo{ErrorCode::kUnknownRoute, "UnknownRoute", "Nothing is served at this path", 404},
    ErrorInfo{ErrorCode::kUnknownMap, "UnknownMap", "No map of this name", 404},
    ErrorInfo{ErrorCode::kUnknownVersion, "UnknownVersion", "The map has no such version", 404},
    ErrorInfo{ErrorCode::kUnknownTile, "UnknownTile", "The map has no such tile", 404},
    ErrorInfo{ErrorCode::kUnknownLayer, "UnknownLayer", "There is no such layer", 404},
    ErrorInfo{ErrorCode::kUnknownDrive, "UnknownDrive", "The map has no such drive", 404},
    ErrorInfo{ErrorCode::kUnknownUpload, "UnknownUpload", "There is no such upload", 404},
    ErrorInfo{ErrorCode::kUnknownJob, "UnknownJob", "No such job", 404},
    ErrorInfo{ErrorCode::kUnknownKey, "UnknownKey", "No such key", 404},
    ErrorInfo{ErrorCode::kUnknownSession, "UnknownSession", "No such session, or it has ended",
              404},
    ErrorInfo{ErrorCode::kUnknownSet, "UnknownSet", "No set of maps of this name", 404},
    ErrorInfo{ErrorCode::kMethodNotAllowed, "MethodNotAllowed", "Wrong method for this path", 405},
    ErrorInfo{ErrorCode::kNotAcceptable, "NotAcceptable", "The answer has no such form", 406},
    ErrorInfo{ErrorCode::kNoActiveVersion, "NoActiveVersion", "No version of the map is active",
              409},
    ErrorInfo{ErrorCode::kOtherDigest, "OtherDigest", "This name was used for something else", 409},
    ErrorInfo{ErrorCode::kVersionActive, "VersionActive", "The version is active", 409},
    ErrorInfo{ErrorCode::kVersionUnusable, "VersionUnusable", "The version cannot be loaded", 409},
    ErrorInfo{ErrorCode::kNoPrevious, "NoPrevious", "There is no version to go back to", 409},
    ErrorInfo{ErrorCode::kOtherFrame, "OtherFrame", "The version is in another map frame", 409},
    ErrorInfo{ErrorCode::kInUse, "InUse", "Something that has not ended needs it", 409},
    ErrorInfo{ErrorCode::kOtherRequest, "OtherRequest",
              "The idempotency key was used for another request", 409},
    ErrorInfo{ErrorCode::kJobFinished, "JobFinished", "The job has ended", 409},
    ErrorInfo{ErrorCode::kDriveNotOpen, "DriveNotOpen", "It takes no more parts", 409},
    ErrorInfo{ErrorCode::kDriveNotComplete, "DriveNotComplete", "The drive is not complete", 409},
    ErrorInfo{ErrorCode::kPartsMissing, "PartsMissing", "Parts are missing", 409},
    ErrorInfo{ErrorCode::kOtherServer, "OtherServer", "Another server has it in its folder", 409},
    ErrorInfo{ErrorCode::kSealExpired, "SealExpired", "The seal is too old", 409},
    ErrorInfo{ErrorCode::kSealedVersionGone, "SealedVersionGone",
              "The seal's version is not served any more", 409},
    ErrorInfo{ErrorCode::kScanNotNewer, "ScanNotNewer", "The scan is not newer than the seal", 409},
    ErrorInfo{ErrorCode::kLengthRequired, "LengthRequired", "The body's length is not said", 411},
    ErrorInfo{ErrorCode::kRevisionChanged, "RevisionChanged", "The map has changed meanwhile", 412},
    ErrorInfo{ErrorCode::kPayloadTooLarge, "PayloadTooLarge", "The request is too large", 413},
    ErrorInfo{ErrorCode::kUnsupportedMediaType, "UnsupportedMediaType", "Unknown content type",
              415},
    ErrorInfo{ErrorCode::kRangeNotSatisfiable, "RangeNotSatisfiable", "Not one range of the body",
              416},
    ErrorInfo{ErrorCode::kInvalidPrior, "InvalidPrior", "The prior is not a usable pose", 422},
    ErrorInfo{ErrorCode::kInvalidTransform, "InvalidTransform", "T_base_lidar is not a usable pose",
              422},
    ErrorInfo{ErrorCode::kInvalidOdometry, "InvalidOdometry", "The odometry step is unusable", 422},
    ErrorInfo{ErrorCode::kNoGeodeticOrigin, "NoGeodeticOrigin",
              "The map does not know where on Earth it lies", 422},
    ErrorInfo{ErrorCode::kInvalidPoints, "InvalidPoints", "The scan holds unusable points", 422},
    ErrorInfo{ErrorCode::kInvalidBoxes, "InvalidBoxes", "The boxes of movable objects are unusable",
              422},
    ErrorInfo{ErrorCode::kInvalidUpload, "InvalidUpload", "The upload is not what it should be",
              422},
    ErrorInfo{ErrorCode::kTooFewPoints, "TooFewPoints", "The scan has too few points", 422},
    ErrorInfo{ErrorCode::kNoPose, "NoPose", "The scan was not found in the map", 422},
    ErrorInfo{ErrorCode::kSuperseded, "Superseded", "A newer scan took this one's place", 429},
    ErrorInfo{ErrorCode::kTooManyRequests, "TooManyRequests", "More than this client's share", 429},
    ErrorInfo{ErrorCode::kHeaderTooLarge, "HeaderTooLarge", "The request's header is too large",
              431},
    ErrorInfo{ErrorCode::kClientGone, "ClientGone", "The client has left", 499},
    ErrorInfo{ErrorCode::kInternalError, "InternalError", "The server failed", 500},
    ErrorInfo{ErrorCode::kStorageError, "StorageError", "The server could not read its store", 500},
    ErrorInfo{ErrorCode::kNoMapper, "NoMapper", "This server cannot make maps", 501},
    ErrorInfo{ErrorCode::kBusy, "Busy", "Too many requests at once", 503},
    ErrorInfo{ErrorCode::kTooManyStreams, "TooManyStreams", "Too many event streams at once", 503},
    ErrorInfo{ErrorCode::kMapLoading, "MapLoading", "The map is not ready yet", 503},
    ErrorInfo{ErrorCode::kMapUnusable, "MapUnusable", "The map cannot be used", 503},
    ErrorInfo{ErrorCode::kBeingMade, "BeingMade", "It is still being made", 503},
    ErrorInfo{ErrorCode::kDerivedUnavailable, "DerivedUnavailable", "It could not be made", 503},
    ErrorInfo{ErrorCode::kStateAway, "StateAway", "The server cannot reach its state", 503},
    ErrorInfo{ErrorCode::kPackagesAway, "PackagesAway", "The server cannot reach its packages",
              503},
    ErrorInfo{ErrorCode::kDeadlineExceeded, "DeadlineExceeded", "No answer within the deadline",
              504},
    ErrorInfo{ErrorCode::kOverQuota, "OverQuota", "The store's quota is used up", 507},
    ErrorInfo{ErrorCode::kDiskFull, "DiskFull", "The disk has too little room for it", 507},
};

constexpr bool in_order() {
  for (std::size_t i = 0; i < kErrors.size(); ++i) {
    if (static_cast<std::size_t>(kErrors[i].code) != i) return false;
  }
  return true;
}
static_assert(in_order(), "the table follows the enumeration");

}  // namespace

const ErrorInfo& info_of(ErrorCode code) { return kErrors.at(static_cast<std::size_t>(code)); }

std::span<const ErrorInfo> all_errors() { return kErrors; }

}  // namespace stillmap::server
