# docker build -t sdr-jax . && docker run --rm -v "$PWD:/work" sdr-jax render --images 8 --out streets
FROM python:3.12-slim
ARG EXTRAS=onnx
# hadolint ignore=DL3008
RUN apt-get update && apt-get install -y --no-install-recommends libegl1 libgl1 libgl1-mesa-dri libopengl0 \
 && rm -rf /var/lib/apt/lists/*
COPY . /src
RUN pip install --no-cache-dir -c /src/constraints.txt "/src[$EXTRAS]"
WORKDIR /work
ENTRYPOINT ["sdr-jax"]
