#pragma once
#include <string_view>

#include "common/base/result.hpp"

namespace ledgerline {

/// Whether it is HOST:PORT as gRPC and Fabric have it: a name, an IPv4 address or [IPv6]; the port at most 65535 (a
/// larger one would be cut to 16 bits in silence), and at least `least_port`: 0 lets a listener take a free one.
Status check_endpoint(std::string_view text, unsigned least_port = 1);

}  // namespace ledgerline
