#pragma once
#include <string>

#include "common/config/config.hpp"

namespace ledgerline::endorser {

struct ServeSettings {
  std::string listen{};           ///< ADDRESS:PORT; port 0: a free one
  std::string tls_certificate{};  ///< PEM files of its own server
  std::string tls_key{};
  std::string tls_client_ca{};  ///< PEM file: clients must show a certificate of it; empty: they need none
};

/// A peer's snapshot to begin with, where there is no checkpoint.
struct FirstStateSettings {
  std::string folder{};  ///< as `peer snapshot submitrequest` makes it; empty: all blocks are read
  std::string hash{};    ///< Fabric's snapshot_hash, that another one says it has; empty: nobody has said it
};

struct Settings {
  std::string msp_dir{};     ///< of an endorser within another program; empty: there is none
  int check_one_in = 100;    ///< of so many answers one is compared with the peer's, too
  std::string summary{};     ///< empty: none is written
  std::string checkpoint{};  ///< a file: what it knew, written now and then and at the end; empty: none
  ServeSettings serve{};     ///< of one within another program: to others, too; `listen` empty: to none
  FirstStateSettings first_state{};
};
/// The tables [serve], [start] and [output].
Settings read_settings(Config& config);
/// The table [own_endorser]: within agent or ground.
Settings read_own_endorser_settings(Config& config);

}  // namespace ledgerline::endorser
