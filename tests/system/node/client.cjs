// Fabric's official client behind lines of JSON: one request on standard input, one answer on standard output.
'use strict';
const crypto = require('node:crypto');
const fs = require('node:fs');
const path = require('node:path');
const readline = require('node:readline');
const grpc = require('@grpc/grpc-js');
const { connect, signers, checkpointers } = require('@hyperledger/fabric-gateway');

const [endpoint, tlsCa, mspId, mspDir, channel, contractName] = process.argv.slice(2);
const only = (dir) => fs.readFileSync(path.join(mspDir, dir, fs.readdirSync(path.join(mspDir, dir))[0]));
const rpc = new grpc.Client(endpoint, grpc.credentials.createSsl(fs.readFileSync(tlsCa)));
const sign = signers.newPrivateKeySigner(crypto.createPrivateKey(only('keystore')));
const open = (signer) => connect({
  client: rpc,
  identity: { mspId, credentials: only('signcerts') },
  signer,
  evaluateOptions: () => ({ deadline: Date.now() + 5000 }),
  endorseOptions: () => ({ deadline: Date.now() + 5000 }),
  submitOptions: () => ({ deadline: Date.now() + 5000 }),
  commitStatusOptions: () => ({ deadline: Date.now() + 5000 }),
});
const gateway = open(sign);
const network = gateway.getNetwork(channel);
const contract = network.getContract(contractName);
const base64 = (bytes) => Buffer.from(bytes ?? []).toString('base64');
const arguments_ = (request) => request.args.map((arg) => Buffer.from(arg, 'base64'));
const plainEvent = (event) => ({
  name: event.eventName, payload: base64(event.payload), block: Number(event.blockNumber), tx: event.transactionId,
});

async function take(stream, count, each) {
  const found = [];
  const timer = setTimeout(() => stream.close(), 5000);
  try {
    for await (const item of stream) {
      found.push(await each(item));
      if (found.length === count) break;
    }
  } finally {
    clearTimeout(timer);
    stream.close();
  }
  return found;
}

function plainBlock(block) {
  return {
    number: block.getHeader().getNumber(),
    previous: base64(block.getHeader().getPreviousHash_asU8()),
    dataHash: base64(block.getHeader().getDataHash_asU8()),
    data: block.getData().getDataList_asU8().map(base64),
    flags: [...block.getMetadata().getMetadataList_asU8()[2]],
  };
}

const operations = {
  async submit(request) {
    const commit = await contract.submitAsync(request.fn, { arguments: arguments_(request) });
    const status = await commit.getStatus();
    return {
      result: base64(commit.getResult()), tx: commit.getTransactionId(), code: status.code,
      block: Number(status.blockNumber), successful: status.successful,
    };
  },
  // Endorses all calls before any is submitted, so that they have read the same state.
  async together(request) {
    const endorsed = [];
    for (const call of request.calls) {
      endorsed.push(await contract.newProposal(call.fn, { arguments: arguments_(call) }).endorse());
    }
    const codes = [];
    for (const transaction of endorsed) codes.push((await (await transaction.submit()).getStatus()).code);
    return { codes };
  },
  async twice(request) {
    const transaction = await contract.newProposal(request.fn, { arguments: arguments_(request) }).endorse();
    await (await transaction.submit()).getStatus();
    const second = await transaction.submit();
    return { code: (await second.getStatus()).code, tx: second.getTransactionId() };
  },
  async evaluate(request) {
    return { result: base64(await contract.evaluateTransaction(request.fn, ...arguments_(request))) };
  },
  async badSignature(request) {
    const other = crypto.generateKeyPairSync('ec', { namedCurve: 'P-256' }).privateKey;
    const stranger = open(signers.newPrivateKeySigner(other));
    const target = stranger.getNetwork(channel).getContract(contractName);
    return { result: base64(await target[request.how](request.fn, ...arguments_(request))) };
  },
  async elsewhere(request) {
    const target = gateway.getNetwork(request.channel).getContract(request.contract);
    return { result: base64(await target[request.how](request.fn, ...arguments_(request))) };
  },
  async events(request) {
    const options = request.start === undefined ? {} : { startBlock: BigInt(request.start) };
    return { events: await take(await network.getChaincodeEvents(contractName, options), request.count, plainEvent) };
  },
  // Reads in parts, each part a new stream that goes on where the checkpoint says.
  async checkpointed(request) {
    const checkpoint = checkpointers.inMemory();
    const events = [];
    for (const count of request.counts) {
      const stream = await network.getChaincodeEvents(contractName, { startBlock: BigInt(request.start), checkpoint });
      events.push(...await take(stream, count, async (event) => {
        await checkpoint.checkpointChaincodeEvent(event);
        return plainEvent(event);
      }));
    }
    return { events };
  },
  async blocks(request) {
    const stream = await network.getBlockEvents({ startBlock: BigInt(request.start) });
    return { blocks: await take(stream, request.count, plainBlock) };
  },
  async filtered(request) {
    const stream = await network.getFilteredBlockEvents({ startBlock: BigInt(request.start) });
    return {
      blocks: await take(stream, request.count, (block) => ({
        number: block.getNumber(), channel: block.getChannelId(),
        transactions: block.getFilteredTransactionsList().map((tx) => ({
          tx: tx.getTxid(), code: tx.getTxValidationCode(),
          events: (tx.getTransactionActions()?.getChaincodeActionsList() ?? [])
            .map((action) => [action.getChaincodeEvent().getEventName(), base64(action.getChaincodeEvent().getPayload_asU8())]),
        })),
      })),
    };
  },
  async latency(request) {
    const times = [];
    for (let i = 0; i < request.count; ++i) {
      const begin = process.hrtime.bigint();
      await contract.submitTransaction(request.fn, ...arguments_(request));
      times.push(Number(process.hrtime.bigint() - begin) / 1e6);
    }
    return { times };
  },
};

function plainError(error) {
  return {
    name: error.name, message: error.message, code: error.code, transactionId: error.transactionId,
    details: (error.details ?? []).map((detail) => detail.message),
  };
}

(async () => {
  for await (const line of readline.createInterface({ input: process.stdin })) {
    const request = JSON.parse(line);
    let answer;
    try {
      answer = await operations[request.op](request);
    } catch (error) {
      answer = { error: plainError(error) };
    }
    process.stdout.write(`${JSON.stringify(answer)}\n`);
  }
  gateway.close();
  rpc.close();
})();
