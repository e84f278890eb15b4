#pragma once
#include <dds/dds.h>
#include <dds/ddsi/ddsi_serdata.h>
#include <dds/ddsi/ddsi_sertype.h>

#include <atomic>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "common/dds/raw.hpp"

/// What Cyclone DDS asks of a type, answered for opaque CDR: keyless, bytes in and bytes out. Inside common/dds and its
/// tests alone.
namespace ledgerline::dds {

/// Counted where it happens, on threads of DDS.
struct RefusedCounters {
  std::atomic<std::uint64_t> malformed{0}, too_long{0};
  Refused read() const { return {malformed.load(), too_long.load()}; }
};

/// Cyclone's view of a type: its name. One for each reader and writer, so that each counts for itself. Made with one
/// reference, which dds_create_topic_sertype takes over.
ddsi_sertype* make_raw_type(const std::string& dds_type, std::shared_ptr<RefusedCounters> refused);

/// A message as it goes onto the wire; null, and counted, where it is refused. For dds_writecdr, which takes it over.
ddsi_serdata* make_raw_message(const ddsi_sertype* type, std::span<const std::uint8_t> cdr);
/// The bytes of a message that came in, none where it was refused; valid as long as it is.
std::span<const std::uint8_t> bytes_of(const ddsi_serdata* message);

}  // namespace ledgerline::dds
