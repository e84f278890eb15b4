#pragma once
#include <string>

namespace ledgerline::web {

/// PEM files of one side of TLS; an empty name: there is none.
struct TlsFiles {
  std::string certificate{};  ///< our own, with those between it and its authority behind it
  std::string key{};          ///< of that certificate, not locked; nobody but its owner may read it
  std::string authority{};    ///< whose certificates the other side must have
};

}  // namespace ledgerline::web
