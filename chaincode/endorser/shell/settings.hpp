#pragma once
#include <string>

#include "common/config/config.hpp"

namespace ledgerline::endorser {

struct ServeSettings {
  std::string listen;           ///< ADDRESS:PORT; port 0: a free one
  std::string tls_certificate;  ///< PEM files of its own server
  std::string tls_key;
  std::string tls_client_ca{};  ///< PEM file: clients must show a certificate of it; empty: they need none
};

/// A peer's snapshot to begin with, where there is no checkpoint.
struct FirstStateSettings {
  std::string folder{};  ///< as `peer snapshot submitrequest` makes it; empty: all blocks are read
  std::string hash{};    ///< Fabric's snapshot_hash, that another one says it has; empty: nobody has said it
};

/// The tables [serve], [start] and [output].
struct Settings {
  ServeSettings serve;
  int check_one_in = 100;  ///< of so many answers one is asked of the peer, too
  std::string checkpoint;  ///< Service::Options::checkpoint
  FirstStateSettings first_state;
  std::string summary;  ///< empty: none is written
};
Settings read_settings(Config& config);

/// The table [own_endorser]: within agent or ground.
struct WithinSettings {
  std::string msp_dir;  ///< empty: there is none
  int check_one_in = 100;
  std::string summary;
  std::string checkpoint;  ///< Service::Options::checkpoint
  ServeSettings serve;     ///< to others, too; `listen` empty: to none
  FirstStateSettings first_state{};
};
WithinSettings read_within_settings(Config& config);

}  // namespace ledgerline::endorser
