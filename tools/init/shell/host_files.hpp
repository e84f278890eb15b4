#pragma once
#include <string>
#include <vector>

#include "common/base/result.hpp"
#include "common/crypto/crypto.hpp"

/// What `ledgerline init` puts on a host: new files, and the host's identity, made on it: MSP_DIR/keystore/priv_sk,
/// which never leaves it, and MSP_DIR/signcerts/.
namespace ledgerline::init {

struct NewFile {
  std::string path, content;
  int mode = 0644;
};

/// An error names all that are there.
Status check_new(const std::vector<std::string>& paths);

/// All of them, or none: a file that is there is an error, unless it has this content already.
Status write_new(const std::vector<NewFile>& files);

/// Makes the key (0600, on the disk when this returns) where there is none, and writes the request to `request_file`.
/// An error: either is there already.
Status request_identity(const std::string& msp_dir, const std::string& request_file, const crypto::Subject& subject);

/// Puts a certificate beside the key, after a check that it is of this key and not expired; one that is there is
/// replaced, as when it is renewed. Of a chain the one that is of this key is put first. Returns whose it is.
Result<std::string> take_certificate(const std::string& msp_dir, const std::string& certificate_file);

/// Copies what other hosts may know out of the folder of an embedded ledger or a network (DIR/crypto,
/// DIR/CHANNEL.block) into `out`: authorities/MSPID.pem, tls/MSPID.pem, tls/orderers.pem, CHANNEL.block. No key.
/// Nothing is overwritten: files that are there must be the same.
Status collect_public(const std::string& ledger_dir, const std::string& out);

}  // namespace ledgerline::init
