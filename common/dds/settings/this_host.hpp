#pragma once
#include <cstdint>
#include <set>

#include "common/base/result.hpp"

namespace ledgerline::dds {

/// Inode numbers of this process's sockets.
std::set<std::uint64_t> open_sockets();

/// Makes the kernel drop what reaches Cyclone's sockets of this domain by another interface than loopback. Cyclone
/// binds them to every address even where it is configured to use lo alone, so without this an outsider's datagrams
/// come in. `before`: the sockets from before the domain was made. An error if none of the domain's sockets is found or
/// one takes no filter.
Status hear_this_host_only(std::uint32_t domain, const std::set<std::uint64_t>& before);

}  // namespace ledgerline::dds
