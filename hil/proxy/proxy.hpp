#pragma once
#include "common/base/result.hpp"
#include "hil/proxy/settings.hpp"

namespace ledgerline::hil::proxy {

/// Opens everything, prints {"ready":true,"servers":{"NAME":"127.0.0.1:PORT"}} and forwards until SIGINT or SIGTERM,
/// with what the script and the socket switch; then writes the summary. One thread; returns an error where something
/// could not be opened or written.
Status run(const Settings& settings);

}  // namespace ledgerline::hil::proxy
